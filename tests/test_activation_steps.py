"""Entry and release of constraints: judged by the activation's own bound, in made-up signals and in closed loop."""

import numpy as np

from saphari_drake.math.priority_stack import constraint_step
from saphari_drake.math.small_solvers import cholesky
from saphari_drake.robots import catalog
from saphari_drake.simulation import priority_arm as arm
from saphari_drake.simulation.activation_steps import switch_step_shares


def test_a_switched_row_is_found_and_a_smooth_one_is_not():
    """A stack that switches a row on steps by the whole velocity; the quintic does not."""
    time = np.linspace(0.0, 1.0, 201)
    smooth = np.clip(time - 0.5, 0.0, None) ** 3
    v = np.stack([1.0 + 0.1 * time, np.ones(201)], axis=1)
    assert switch_step_shares(smooth[:, None], v - smooth[:, None] * v).max() <= 1.0
    h = (time > 0.5).astype(float)
    hard = switch_step_shares(1e-3 * h[:, None], v * (1.0 - h[:, None]))
    assert hard.shape == (1,) and hard[0] > 100.0
    assert switch_step_shares(np.zeros((201, 1)), v).size == 0


def test_one_row_changes_the_velocity_by_its_activation_times_its_excess():
    """δ = −h e W⁻¹Jᵀ/(JW⁻¹Jᵀ): the bound that the judge relies on."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        A = rng.standard_normal((7, 7))
        W = A @ A.T + 0.01 * np.eye(7)
        L = np.zeros((7, 7))
        cholesky(W, L)
        J, v = rng.standard_normal((1, 7)), rng.standard_normal(7)
        x = np.array([rng.uniform(-0.05, 0.0)])
        zero, after, h = np.zeros(1), v.copy(), np.zeros(1)
        one = np.array([0.05])
        constraint_step(L, J, x, zero, zero, one, one, zero, 1e-6, after, h)
        excess = max(float(J[0] @ v), 0.0)
        step = np.linalg.solve(W, J[0]) / (J[0] @ np.linalg.solve(W, J[0]))
        np.testing.assert_allclose(after, v - h * excess * step, atol=1e-6)


def test_the_largest_velocity_step_falls_with_the_period():
    """Halving the cycle halves the largest step of the command, also where people come near: nothing is switched."""
    robot, largest = catalog.lwr4(), []
    for period in (0.002, 0.001):
        params = arm.ThreeLevelParameters()
        params.controller.period = period
        run = arm.run_kinematic(arm.three_level_job(robot, params, 0), 4.0)
        largest.append(np.abs(np.diff(run.v, axis=0)).max())
    assert 0.45 < largest[1] / largest[0] < 0.6
