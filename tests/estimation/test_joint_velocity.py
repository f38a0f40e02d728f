"""Joint state behind coarse encoders: quiet, not late, and what is not finite."""

from dataclasses import replace

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.joint_velocity import (
    JointEstimate,
    JointVelocity,
    JointVelocityParameters,
    advanced,
    corrected,
    velocity_gains,
)
from saphari_drake.messages import SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics

STEP = 2.0 * np.pi / 2.0**16
PARAMS = JointVelocityParameters(resolution=STEP, period=0.002)


def follow(motion, modelled, seconds=2.0):
    """Return the errors of the estimated velocity, and of the difference of positions, over the last half."""
    T, before = PARAMS.period, 0.0
    now, gains, errors = JointEstimate(np.zeros(1), np.zeros(1), np.zeros(1)), velocity_gains(np.ones(1), PARAMS), []
    for k in range(1, round(seconds / T)):
        q, v = motion(k * T)
        read = STEP * np.round(q / STEP)
        now = corrected(advanced(now, np.array([modelled((k - 0.5) * T)]), T), np.array([read]), gains)
        errors.append((now.v[0] - v, (read - before) / T - v))
        before = read
    return np.array(errors)[len(errors) // 2 :].T


def test_it_is_far_quieter_than_the_difference_where_the_model_explains_the_motion():
    """A swing of 0.3 rad at 1 Hz."""
    w = 2.0 * np.pi
    estimated, difference = follow(
        lambda t: (0.3 * (1.0 - np.cos(w * t)), 0.3 * w * np.sin(w * t)), lambda t: 0.3 * w**2 * np.cos(w * t)
    )
    assert np.abs(difference).max() > 0.04
    assert np.abs(estimated).max() < 0.1 * np.abs(difference).max()


def test_a_constant_torque_that_the_model_does_not_know_leaves_no_error():
    estimated, _ = follow(lambda t: (0.25 * t**2, 0.5 * t), lambda t: 0.0)
    assert np.abs(estimated).max() < 3e-3


def test_gains_grow_with_what_is_unknown_and_fall_with_inertia_and_encoder_step():
    usual = velocity_gains(np.array([1.0]), PARAMS)
    assert np.all(velocity_gains(np.array([0.1]), PARAMS) > usual)
    assert np.all(velocity_gains(np.array([1.0]), replace(PARAMS, unknown_torque=1.0)) > usual)
    assert np.all(velocity_gains(np.array([1.0]), replace(PARAMS, resolution=10.0 * STEP)) < usual)


def bench_of(robot):
    terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
    system = JointVelocity(robot, replace(PARAMS, period=PERIOD))
    ports = {"position_measured": robot.home, "velocity_measured": np.zeros(robot.n), "torque_applied": terms.g}
    return Bench(system, dynamics=terms, **ports), ports


def test_at_rest_it_stays_at_rest(lwr4):
    bench, _ = bench_of(lwr4)
    for _ in range(20):
        bench.run()
    np.testing.assert_allclose(bench.read("position_estimated"), lwr4.home)
    for name in ("velocity_estimated", "acceleration_estimated", "acceleration_unmodelled"):
        np.testing.assert_allclose(bench.read(name), 0.0, atol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("port", ["position_measured", "velocity_measured", "torque_applied"])
def test_it_starts_anew_after_what_is_not_finite(lwr4, port, bad):
    bench, good = bench_of(lwr4)
    bench.run()
    bench.set(**{port: np.r_[bad, np.zeros(6)]})
    if port != "torque_applied":
        assert bench.read("system_status") == SystemStatus.BAD_INPUT
        assert np.isnan(bench.read("velocity_estimated")).all() and np.isnan(bench.read("position_estimated")).all()
    bench.run()
    bench.set(**good)
    assert bench.read("system_status") == SystemStatus.OK
    np.testing.assert_allclose(bench.read("velocity_estimated"), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["resolution", "unknown_torque", "envelope_torque", "change_time", "period"])
def test_bad_parameters(name):
    with pytest.raises(ParameterError, match=name):
        JointVelocityParameters(**{name: np.nan})
