"""Speed and separation monitoring as a system: it scales, stops on what is not known, and remembers nothing."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.speed_scale import ScaleStatus
from saphari_drake.safety.speed_separation.parameters import SpeedSeparationParameters
from saphari_drake.safety.speed_separation.stopping import StoppingTable
from saphari_drake.safety.speed_separation.system import SpeedSeparation

SLOW = StoppingTable("made up", 0.85, [0.0, 1.0], [[0.05, 0.3]] * 3, [[0.0, 0.15]] * 3)
COMMAND = np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def at(*points, **others):
    p = np.array(points, dtype=float).reshape(-1, 3)
    return ObstaclePoints(p, np.zeros_like(p), np.zeros(len(p)), **{"stamp": 0.0, **others})


@pytest.fixture(scope="module")
def bench(lwr4):
    return Bench(SpeedSeparation(lwr4, table=SLOW))


@pytest.fixture
def b(bench, lwr4):
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    bench.context.SetTime(0.0)
    bench.set(dynamics=terms, velocity_commanded=COMMAND, people=at([9.0, 0.0, 0.0]))
    return bench


def beside(lwr4, away):
    """A point beside the flange, on the side that it turns to."""
    return lwr4.kinematics(lwr4.home).p_WL[6] + [0.0, 0.04 + away, 0.0]


def test_people_slow_and_stop_it(b, lwr4):
    scales = []
    for away in (2.0, 0.35, 0.25, 0.02):
        b.set(people=at(beside(lwr4, away)))
        scales.append(b.read("speed_scale"))
        np.testing.assert_allclose(b.read("velocity_applied"), scales[-1] * COMMAND)
    assert scales[0] == 1.0 > scales[1] > scales[2] > scales[3] == 0.0
    assert b.read("status") == ScaleStatus.STOPPED


FAULTS = {
    "nan command": ({"velocity_commanded": np.full(7, np.nan)}, ScaleStatus.BAD_INPUT),
    "lost": ({"people": at([9.0, 0, 0], status=ObstacleStatus.LOST)}, ScaleStatus.PEOPLE_LOST),
    "old": ({"people": at([9.0, 0, 0], stamp=-0.3)}, ScaleStatus.PEOPLE_LOST),
    "no number": ({"people": at([np.nan, 0, 0])}, ScaleStatus.PEOPLE_LOST),
    "no stamp": ({"people": at([9.0, 0, 0], stamp=np.nan)}, ScaleStatus.PEOPLE_LOST),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_not_known_stops_it(b, fault):
    inputs, status = FAULTS[fault]
    b.set(**inputs)
    assert b.read("status") == status
    assert b.read("speed_scale") == 0.0
    np.testing.assert_array_equal(b.read("velocity_applied"), 0.0)


def test_a_state_that_is_not_known_stops_it(b, lwr4):
    b.set(dynamics=evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).unknown())
    assert b.read("status") == ScaleStatus.BAD_INPUT
    np.testing.assert_array_equal(b.read("velocity_applied"), 0.0)


def test_age_counts(b, lwr4):
    """The same people, seen earlier, leave less."""
    b.set(people=at(beside(lwr4, 0.35)))
    now = b.read("speed_scale")
    b.set(people=at(beside(lwr4, 0.35), stamp=-0.05))
    assert b.read("speed_scale") < now


def test_numbers_that_cannot_be_used_are_named():
    for name, value in (("person_speed", -1.0), ("people_timeout", 0.0), ("person_acceleration", 0.0)):
        with pytest.raises(ParameterError, match=name):
            SpeedSeparationParameters(**{name: value})
