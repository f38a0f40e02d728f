"""Entry and release of constraints, judged by the activation's own bound."""

import numpy as np
from experiments.priority import three_level as arm
from experiments.priority.switches import find_switches

from saphari_drake.control.reverse_priority.law import Rows, Settings, constraint_step
from saphari_drake.control.reverse_priority.stack import PriorityStack
from saphari_drake.control.reverse_priority.system import position_reference
from saphari_drake.control.reverse_priority.tasks import Bound, plane_distance, position_task
from saphari_drake.math.products import cholesky

NOWHERE = np.zeros((0, 6))


def test_a_switch_is_found_with_the_velocity_it_adds(lwr4):
    """Entry and release of a plane's row; the step is what the row adds, and infinite bounds take it out."""
    wall = Bound(plane_distance(lwr4, "link_7", [0, 0, 1]), upper=0.6, buffer=0.02)
    stack = PriorityStack(lwr4, [[wall], position_task(lwr4, "link_7")])
    x = float(stack.constraints(lwr4.home, NOWHERE)[0][0])
    stack.bounds[0] = x + 0.01
    reference = position_reference(lwr4.kinematics(lwr4.home).p_WL[6] + [0.0, 0.0, 0.05])[None]
    q, zero = np.tile(lwr4.home, (4, 1)), np.zeros((4, 7))
    result = stack.solve(lwr4.home, zero[0], reference, NOWHERE, 0.005)
    free = stack.solve(lwr4.home, zero[0], reference, NOWHERE, 0.005, np.array([np.inf]))
    assert 0.1 < result.activation[0] < 1.0 and free.activation[0] == 0.0
    h = np.array([[0.0], result.activation, result.activation, [0.0]])
    switches = find_switches(stack, q, zero, np.tile(reference, (4, 1, 1)), np.zeros((4, 0, 6)), h, 0.005)
    assert [(s.cycle, s.row) for s in switches] == [(1, 0), (2, 0)]
    step = np.abs(result.v - free.v).max()
    assert step > 0.01 and switches[0].step == step
    assert switches[0].share == step / (result.activation[0] * lwr4.v_max.max()) < 1.0


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
        buffer, settings = np.array([0.05]), Settings(np.full(7, 1e9), 1e-6, 0.1, 1.0)
        constraint_step(L, Rows(J, x, zero, zero, zero, buffer, buffer), settings, after, h)
        excess = max(float(J[0] @ v), 0.0)
        step = np.linalg.solve(W, J[0]) / (J[0] @ np.linalg.solve(W, J[0]))
        np.testing.assert_allclose(after, v - h * excess * step, atol=1e-6)


def test_the_largest_velocity_step_falls_with_the_period(lwr4):
    """Halving the cycle halves the largest step of the command, also where people come near: nothing is switched."""
    largest = []
    for period in (0.002, 0.001):
        params = arm.ThreeLevelParameters()
        params.controller.period = period
        run = arm.run_kinematic(arm.three_level_job(lwr4, params, 0), 4.0)
        largest.append(np.abs(np.diff(run.v, axis=0)).max())
    assert 0.45 < largest[1] / largest[0] < 0.6
