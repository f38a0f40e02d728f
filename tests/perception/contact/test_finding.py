"""Which contact counts: where a touch that is felt is explained, or where the person is seen."""

import numpy as np

from saphari_drake.messages import ContactPoint
from saphari_drake.perception.contact.finding import Found, still_near
from saphari_drake.perception.contact.track import ContactTrack


def track(link):
    return ContactTrack(ContactPoint(link >= 0, link, np.zeros(3), np.ones(3), 0.02, 1.0))


def test_a_touch_that_is_felt_is_where_all_evidence_places_it():
    seen, touch, nothing = track(2), track(4), track(-1)
    assert Found(seen, touch, felt=True).contact.link == 4
    assert Found(seen, touch).contact.link == 2
    assert not Found(seen, nothing, felt=True).contact.found
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
