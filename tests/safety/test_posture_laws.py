"""The laws of a robot that gives way and of one whose state is lost."""

import numpy as np
import pytest

from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.posture_laws import Coasting, Yield, yield_torque

GAINS = Yield(*(np.full(7, value) for value in (25.0, 10.0, 0.15, 225.0, 30.0)))


def acceleration(robot, bent, v=0.0):
    terms = evaluate_dynamics(robot, robot.home + bent, np.full(7, v))
    return np.linalg.solve(terms.M, yield_torque(terms, robot.home, GAINS) - terms.Cv - terms.g)


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
