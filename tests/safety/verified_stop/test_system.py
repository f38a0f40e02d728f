"""The verified stop as a system: a source that hangs, lies or is lost, people that are not known, its Context."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters
from saphari_drake.safety.verified_stop.law import StopStatus
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters
from saphari_drake.safety.verified_stop.system import VerifiedStop

PERIOD = 0.005  # of the bench
COMMAND = np.full(7, 0.3)


def stop_of(robot, **changes):
    return VerifiedStop(robot, VerifiedStopParameters(motion=VelocityEnvelopeParameters(period=PERIOD), **changes))


def at(*points, stamp=0.0, **others):
    p = np.array(points, dtype=float).reshape(-1, 3)
    return ObstaclePoints(p, np.zeros_like(p), np.zeros(len(p)), stamp, **others)


def moving(robot, **inputs):
    """Return a bench whose robot moves as commanded."""
    b = Bench(stop_of(robot), position_measured=robot.home, velocity_commanded=COMMAND, **inputs)
    b.run(20)
    np.testing.assert_allclose(b.read("velocity_applied"), COMMAND)
    assert b.read("status") == StopStatus.PASSING
    return b


FAULTS = {
    "nan": ({"velocity_commanded": np.full(7, np.nan)}, StopStatus.BAD_INPUT),
    "infinite": ({"velocity_commanded": np.full(7, np.inf)}, StopStatus.BAD_INPUT),
    "encoder": ({"position_measured": np.full(7, np.nan)}, StopStatus.BAD_INPUT),
    "hangs": ({"command_time": 0.1 - 0.3}, StopStatus.STALE),
    "no clock": ({"command_time": np.nan}, StopStatus.STALE),
    "lost": ({"people": at([9.0, 0, 0], status=ObstacleStatus.LOST)}, StopStatus.OBSTACLES_LOST),
    "old": ({"people": at([9.0, 0, 0], stamp=-5.0)}, StopStatus.OBSTACLES_LOST),
    "no number": ({"people": at([np.nan, 0, 0])}, StopStatus.OBSTACLES_LOST),
    "wrong size": ({"things": ObstaclePoints(np.ones((2, 3)), stamp=0.0)}, StopStatus.OBSTACLES_LOST),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_whatever_is_wrong_the_robot_stops_and_tells(lwr4, fault):
    """And goes on when all is well again."""
    inputs, status = FAULTS[fault]
    b = moving(lwr4, people=at([9.0, 0, 0]), things=at([9.0, 0, 0]), command_time=0.1)
    before = b.read("velocity_applied")
    b.run(1, **inputs)
    assert b.read("status") == status
    assert np.all(np.abs(b.read("velocity_applied")) < np.abs(before))
    b.run(20)
    np.testing.assert_array_equal(b.read("velocity_applied"), 0.0)
    good = {"position_measured": lwr4.home, "velocity_commanded": COMMAND, "command_time": 0.2}
    b.run(20, people=at([9.0, 0, 0]), things=at([9.0, 0, 0]), **good)
    np.testing.assert_allclose(b.read("velocity_applied"), COMMAND)


def test_people_stop_it_and_things_less(lwr4):
    """A person counts with what can be reached meanwhile, a thing does not."""
    hand = lwr4.kinematics(lwr4.home).p_WL[-1]
    for port, passes in (("people", False), ("things", True)):
        b = moving(lwr4)
        b.run(20, **{port: at(hand + [0.0, 0.0, 0.25])})
        assert bool(np.any(b.read("velocity_applied"))) == passes
        assert (b.read("margin") > 0.0) or not passes
    assert 0.0 < b.read("stop_time") < 0.1


def test_an_old_picture_of_people_counts_less_than_a_new_one(lwr4):
    hand = lwr4.kinematics(lwr4.home).p_WL[-1]
    margins = []
    for stamp in (0.1, 0.0):
        b = moving(lwr4)
        b.run(1, people=at(hand + [0.0, 0.0, 1.4], stamp=stamp))
        margins.append(b.read("margin"))
    assert margins[0] - margins[1] == pytest.approx(0.2, abs=0.03)


def test_a_clone_goes_on_as_the_original(lwr4):
    one = moving(lwr4)
    two = one.clone()
    for b in (one, two):
        b.run(5, velocity_commanded=-COMMAND)
    np.testing.assert_array_equal(one.read("velocity_applied"), two.read("velocity_applied"))


@pytest.mark.parametrize("field", ["person_speed", "person_error", "people_timeout", "intervals", "tracking_error"])
def test_bad_parameters_are_named(field):
    with pytest.raises(ParameterError, match=field):
        VerifiedStopParameters(**{field: -1})


@pytest.mark.parametrize(("touch", "above", "passes"), [(True, 0.6, True), (True, 0.0, False), (False, 0.6, False)])
def test_a_hand_may_be_touched_softly_but_no_head(lwr4, touch, above, passes):
    """What is within 0.3 m of a person's top is its head; without leave nobody is touched while the robot moves."""
    turned = lwr4.home.copy()
    turned[0] += 0.35
    tip, command = lwr4.kinematics(turned).p_WL[-1], np.array([0.2, 0, 0, 0, 0, 0, 0])
    people = at(tip, tip + [0.0, 0.0, above])
    b = Bench(stop_of(lwr4, touch=touch), position_measured=lwr4.home, velocity_commanded=command, people=people)
    b.run(60, people=ObstaclePoints(people.p_WO, people.v_WO, people.radius, 0.2))
    assert (b.read("velocity_applied")[0] > 0.19) == passes
