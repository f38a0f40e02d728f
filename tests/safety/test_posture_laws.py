"""The laws of a robot that gives way and of one whose state is lost."""

import numpy as np
import pytest

from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.posture_laws import Coasting, Yield, posture_torque, yield_torque

GAINS = Yield(*(np.full(7, value) for value in (25.0, 10.0, 0.15, 225.0, 30.0)))


def acceleration(robot, bent, v=0.0):
    terms = evaluate_dynamics(robot, robot.home + bent, np.full(7, v))
    return np.linalg.solve(terms.M, yield_torque(terms, robot.home, GAINS) - terms.Cv - terms.g)


def drawn(robot, seed):
    rng = np.random.default_rng(seed)
    terms = evaluate_dynamics(robot, robot.home + rng.uniform(-0.5, 0.5, 7), rng.normal(size=7))
    return terms, terms.q + rng.uniform(-0.3, 0.3, 7)


@pytest.mark.parametrize("seed", range(10))
def test_damping_takes_energy(lwr4, seed):
    """With the same D on all joints the power of what a law adds for the velocity, Coriolis apart, is −D q̇ᵀ M q̇."""
    terms, q_d = drawn(lwr4, seed)
    K, none, D = np.full(7, 100.0), np.zeros(7), 20.0
    held = posture_torque(terms, q_d, K, np.full(7, D)) - posture_torque(terms, q_d, K, none)
    soft = [Yield(K, np.full(7, d), np.full(7, 10.0), K, np.full(7, d)) for d in (D, 0.0)]
    yielding = yield_torque(terms, q_d, soft[0]) - yield_torque(terms, q_d, soft[1])
    coasting = Coasting(terms.M, terms.g, terms.v).torque(np.full(7, D)) - terms.g
    for torque in (held, yielding, coasting):
        assert torque @ terms.v == pytest.approx(-D * terms.v @ terms.M @ terms.v) and torque @ terms.v < 0.0


@pytest.mark.parametrize("seed", range(10))
def test_a_held_posture_has_the_closed_loop_that_is_told(lwr4, seed):
    """Each joint for itself: M q̈ + C q̇ + g = τ leaves q̈ = K (q_d − q) − D q̇."""
    terms, q_d = drawn(lwr4, seed)
    K, D = np.linspace(50.0, 200.0, 7), np.linspace(5.0, 30.0, 7)
    a = np.linalg.solve(terms.M, posture_torque(terms, q_d, K, D) - terms.Cv - terms.g)
    np.testing.assert_allclose(a, K * (q_d - terms.q) - D * terms.v, atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_yielding_is_soft_up_to_the_travel_and_stiff_beyond(lwr4, sign):
    np.testing.assert_allclose(acceleration(lwr4, sign * 0.1, 0.2), -25.0 * sign * 0.1 - 10.0 * 0.2)
    np.testing.assert_allclose(acceleration(lwr4, sign * 0.25, 0.2), -sign * (25.0 * 0.15 + 225.0 * 0.1) - 30.0 * 0.2)


def test_no_jump_at_the_travel(lwr4):
    at = [acceleration(lwr4, 0.15 + x, 0.5) for x in (-1e-6, 1e-6)]
    np.testing.assert_allclose(at[0], at[1], atol=1e-2)


def test_a_coasting_robot_is_brought_to_rest_without_feedback(lwr4):
    """Simulated with the same model: little speed is left, and the way is that of braking."""
    v0, D, T = np.array([0.5, -0.3, 0.4, 0.3, 0.8, -0.5, 1.0]), np.full(7, 30.0), 0.005
    q, v = lwr4.home.copy(), v0.copy()
    start = evaluate_dynamics(lwr4, q, v)
    left = Coasting(start.M, start.g, v)
    for k in range(300):
        if k % 5 == 0:
            torque, left = left.torque(D), left.after(D, T)
        terms = evaluate_dynamics(lwr4, q, v)
        v = v + 1e-3 * np.linalg.solve(terms.M, torque - terms.Cv - terms.g)
        q = q + 1e-3 * v
    assert np.max(np.abs(v)) < 0.15 * np.max(v0)
    np.testing.assert_allclose(q - lwr4.home, v0 / 30.0, atol=0.02)
