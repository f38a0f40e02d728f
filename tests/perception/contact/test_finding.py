"""Which contact counts: what is seen at the robot, then what explains the residual, then nothing."""

import numpy as np

from saphari_drake.messages import ContactPoint
from saphari_drake.perception.contact.finding import Found, still_near
from saphari_drake.perception.contact.track import ContactTrack


def track(link):
    return ContactTrack(ContactPoint(link >= 0, link, np.zeros(3), np.ones(3), 0.02, 1.0))


def test_what_is_seen_at_the_robot_counts_before_what_is_felt_elsewhere():
    seen, hidden, nothing = track(2), track(4), track(-1)
    assert Found(seen, hidden, near=True, doubted=True).contact.link == 2
    assert Found(seen, hidden, near=False, doubted=True).contact.link == 4
    assert Found(seen, hidden, near=False, doubted=False).contact.link == 2
    unsure = Found(seen, nothing, near=False, doubted=True).contact
    assert not unsure.found and unsure.stamp == 1.0
    assert not Found().contact.found


def test_what_was_seen_at_the_robot_stays_while_the_touch_is_felt():
    """A distance that leaves `near` for a frame changes nothing; a release, a lost track or a new touch does."""
    touching, away = track(2).contact, track(-1).contact
    felt = Found(near=True, felt=True)
    assert touching.distance > 0.015
    assert still_near(felt, touching, True, 0.015)
    assert not still_near(felt, touching, False, 0.015)
    assert not still_near(Found(near=True), touching, True, 0.015)
    assert not still_near(felt, away, True, 0.015)
    assert still_near(Found(), touching, False, 0.03)
