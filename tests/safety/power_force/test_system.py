"""Power and force limiting as a system: it scales, and stops on what is not known."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import UnknownNameError
from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.power_force.parameters import PowerForceParameters
from saphari_drake.safety.power_force.system import PowerForceLimit
from saphari_drake.safety.speed_scale import ScaleStatus

COMMAND = np.array([1.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def at(*points, **others):
    p = np.array(points, dtype=float).reshape(-1, 3)
    return ObstaclePoints(p, np.zeros_like(p), np.full(len(p), 0.03), **{"stamp": 0.0, **others})


@pytest.fixture(scope="module")
def bench(lwr4):
    return Bench(PowerForceLimit(lwr4, PowerForceParameters(head_height=0.0)))


@pytest.fixture
def b(bench, lwr4):
    bench.set(dynamics=evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)), velocity_commanded=COMMAND, people=at())
    return bench


def test_it_limits_the_energy_of_the_applied_velocity(b, lwr4):
    b.set(people=at(lwr4.kinematics(lwr4.home).p_WL[6] + [0.0, 0.08, 0.0]))
    scale, energy, limit = (b.read(name) for name in ("speed_scale", "energy", "energy_limit"))
    np.testing.assert_allclose(b.read("velocity_applied"), scale * COMMAND)
    assert energy * scale**2 <= limit * (1.0 + 1e-9)
    assert b.read("status") == (ScaleStatus.FREE if scale == 1.0 else ScaleStatus.REDUCED)
    b.set(velocity_commanded=4.0 * COMMAND)
    assert b.read("speed_scale") < 1.0 and b.read("status") == ScaleStatus.REDUCED


def test_a_head_stops_it(lwr4):
    """One ball alone is the top of a person."""
    b = Bench(PowerForceLimit(lwr4), dynamics=evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)),
              velocity_commanded=COMMAND, people=at(lwr4.kinematics(lwr4.home).p_WL[6] + [0.0, 0.08, 0.0]))  # fmt: skip
    assert b.read("speed_scale") == 0.0 and b.read("status") == ScaleStatus.STOPPED


@pytest.mark.parametrize(
    ("inputs", "status"),
    [
        ({"velocity_commanded": np.full(7, np.inf)}, ScaleStatus.BAD_INPUT),
        ({"people": at([9.0, 0, 0], status=ObstacleStatus.LOST)}, ScaleStatus.PEOPLE_LOST),
        ({"people": at([9.0, 0, 0], stamp=-1.0)}, ScaleStatus.PEOPLE_LOST),
        ({"people": at([9.0, 0, np.inf])}, ScaleStatus.PEOPLE_LOST),
        ({"people": at([9.0, 0, 0], stamp=np.nan)}, ScaleStatus.PEOPLE_LOST),
    ],
)
def test_what_is_not_known_stops_it(b, inputs, status):
    b.set(**inputs)
    assert b.read("status") == status
    np.testing.assert_array_equal(b.read("velocity_applied"), 0.0)


def test_things_that_hold_at_all_times_never_grow_old(b):
    """Without a stamp they are known, as they are to the separation monitor."""
    b.set(people=at([9.0, 0, 0], stamp=-np.inf))
    assert b.read("status") == ScaleStatus.FREE and b.read("speed_scale") == 1.0


def test_a_region_that_is_not_there_is_told(lwr4):
    with pytest.raises(UnknownNameError, match="knee"):
        PowerForceLimit(lwr4, PowerForceParameters(regions=["knee"]))
