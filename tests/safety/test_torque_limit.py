"""The torque limit: nothing beyond the limits, nothing that is not a number."""

import numpy as np
import pytest
from bench import Bench
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from saphari_drake.errors import ParameterError
from saphari_drake.messages import SystemStatus
from saphari_drake.robots.catalog import lwr4 as load
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.torque_limit import TorqueLimit

ROBOT = load()
LIMIT = Bench(TorqueLimit(ROBOT, 0.005), torque_commanded=np.zeros(7))


@given(arrays(float, 7, elements=st.floats(allow_nan=True, allow_infinity=True)))
def test_applied_torque_is_always_finite_and_within_the_limits(command):
    """Any torque at all; what is cut off is told, and a command within the limits passes as it is."""
    LIMIT.set(torque_commanded=command)
    applied, excess = LIMIT.read("torque_applied"), LIMIT.read("torque_excess")
    assert np.isfinite(applied).all() and np.all(np.abs(applied) <= ROBOT.tau_max)
    if not np.isfinite(command).all():
        assert LIMIT.read("system_status") == SystemStatus.BAD_INPUT
        return
    assert LIMIT.read("system_status") == SystemStatus.OK
    np.testing.assert_array_equal(applied, np.clip(command, -ROBOT.tau_max, ROBOT.tau_max))
    np.testing.assert_array_equal(excess, command - applied)


def test_a_command_that_is_lost_leaves_the_last_one_for_as_long_as_it_lasts(lwr4):
    """At the start it is the weight at home; afterwards the next command passes at once."""
    bench, bad = Bench(TorqueLimit(lwr4, 0.005), torque_commanded=np.full(7, np.nan)), np.r_[np.zeros(6), np.inf]
    gravity = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g
    np.testing.assert_array_equal(bench.read("torque_applied"), gravity)
    last = np.arange(7.0)
    bench.run(torque_commanded=last)
    for _ in range(3):
        bench.run(torque_commanded=bad)
        np.testing.assert_array_equal(bench.read("torque_applied"), last)
        np.testing.assert_array_equal(bench.read("torque_excess"), 0.0)
    bench.set(torque_commanded=2.0 * last)
    np.testing.assert_array_equal(bench.read("torque_applied"), 2.0 * last)


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_bad_period(lwr4, period):
    with pytest.raises(ParameterError, match="period"):
        TorqueLimit(lwr4, period)
