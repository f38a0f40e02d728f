"""Joint acceleration: the difference of two velocities, and what is not finite."""

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.joint_acceleration import JointAcceleration
from saphari_drake.messages import SystemStatus


def test_it_is_the_change_over_a_period(lwr4):
    """Exact for a constant acceleration, in the same cycle."""
    a = np.linspace(-3.0, 3.0, 7)
    bench = Bench(JointAcceleration(lwr4, PERIOD), velocity_measured=np.zeros(7))
    for k in range(1, 5):
        bench.run()
        bench.set(velocity_measured=k * PERIOD * a)
        np.testing.assert_allclose(bench.read("acceleration_measured"), a)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_it_is_not_known_while_one_of_both_velocities_is_not(lwr4, bad):
    bench = Bench(JointAcceleration(lwr4, PERIOD), velocity_measured=np.ones(7))
    bench.run()
    bench.set(velocity_measured=np.r_[bad, np.ones(6)])
    for known in (False, False, True):
        status = SystemStatus.OK if known else SystemStatus.BAD_INPUT
        assert bench.read("system_status") == status
        assert np.isnan(bench.read("acceleration_measured")).all() != known
        bench.run()
        bench.set(velocity_measured=np.ones(7))


@pytest.mark.parametrize("period", [0.0, np.nan])
def test_bad_period(lwr4, period):
    with pytest.raises(ParameterError, match="period"):
        JointAcceleration(lwr4, period)
