"""Accelerations that are bounded: within a plan, from plan to plan and over time, and the same plan by all solvers."""

import nmpc_problems as bench
import numpy as np
import pytest

from saphari_drake.control.nmpc.kinematics import advance, ramp_mean, ramped
from saphari_drake.control.nmpc.law import at_rest, nmpc_step, solve
from saphari_drake.control.nmpc.limits import feasible_start, stoppable
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, NmpcStatus, TestPoint
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.messages import ObstaclePoints

POINTS = [TestPoint("elbow", "link_4"), TestPoint("wrist", "link_6"), TestPoint("hand", "link_7")]


def arm_problem(robot, **changes):
    return NmpcProblem(robot, "link_7", POINTS, NmpcParameters(**{"ramp": 1.0, "acceleration_max": [3.0]} | changes))


def target(problem, q):
    R, p = problem.end_effector_pose(q)
    return NmpcReference(p[None], R[None])


def accelerations(problem, scene, Q):
    """Return the changes of velocity (N, n) of a plan, from v0 on, over the largest allowed."""
    v = np.diff(np.vstack([scene.q0, Q]), axis=0) / problem.params.period
    return np.diff(np.vstack([scene.v0, v]), axis=0) / problem.data.change


def scene_at(problem, robot, seed):
    rng = np.random.default_rng(seed)
    q = robot.home + rng.uniform(-0.5, 0.5, 7)
    far = ObstaclePoints(np.array([[0.55, -0.35, 0.6]]), np.zeros((1, 3)), np.zeros(1), 0.0)
    return problem.scene(q, target(problem, robot.home + rng.uniform(-0.3, 0.3, 7)), far, v0=rng.uniform(-0.8, 0.8, 7))


@pytest.mark.parametrize("seed", range(3))
def test_all_solvers_find_the_same_plan(lwr4, seed):
    """With bounded changes, some of them active; SNOPT on the whole nonlinear problem as the reference."""
    plans = []
    for solver in ("active_set", "daqp", "snopt"):
        problem = arm_problem(lwr4, solver=solver, tolerance=1e-7, obstacle_cost=False, max_iterations=100)
        scene = scene_at(problem, lwr4, seed)
        found = solve(problem, scene, np.tile(scene.q0, (10, 1)))
        assert found.status == NmpcStatus.SOLVED
        shares = accelerations(problem, scene, found.Q)
        assert 1.0 - 1e-6 < np.abs(shares).max() < 1.0 + 1e-6
        plans.append(found.Q)
    np.testing.assert_allclose(plans[1], plans[0], atol=1e-6)
    np.testing.assert_allclose(plans[2], plans[0], atol=2e-4)


@pytest.mark.parametrize("solver", ["active_set", "daqp"])
def test_position_limits_yield_to_what_braking_cannot_prevent(lwr4, solver):
    """A joint that runs at its limit is braked as fast as allowed, instead of a problem without solution."""
    problem = arm_problem(lwr4, solver=solver)
    q = lwr4.home.copy()
    q[0] = lwr4.q_max[0] - 0.02
    v0 = np.array([1.0, 0, 0, 0, 0, 0, 0])
    scene = problem.scene(q, target(problem, lwr4.home + 0.3), ObstaclePoints(), v0=v0)
    found = solve(problem, scene, np.tile(q, (10, 1)))
    assert found.status != NmpcStatus.UNSOLVED
    v = np.diff(np.vstack([q, found.Q]), axis=0)[:, 0] / 0.1
    np.testing.assert_allclose(v[:3], [0.7, 0.4, 0.1], atol=1e-6)


@pytest.mark.parametrize("seed", range(50))
def test_any_guess_is_moved_into_all_limits(lwr4, seed):
    problem, rng = arm_problem(lwr4), np.random.default_rng(seed)
    scene = scene_at(problem, lwr4, seed)
    Q = feasible_start(problem.data, scene, scene.q0 + np.cumsum(rng.normal(size=(10, 7)), axis=0))
    assert np.abs(accelerations(problem, scene, Q)).max() <= 1.0 + 1e-9
    assert np.all((Q <= lwr4.q_max + 1e-12) & (Q >= lwr4.q_min - 1e-12))
    v = np.diff(np.vstack([scene.q0, Q]), axis=0) / 0.1
    assert np.all(np.abs(v) <= problem.data.v_max + 1e-9)


def test_what_is_stoppable_is_stopped_in_stages():
    rng = np.random.default_rng(0)
    for _ in range(500):
        room, d, T = rng.uniform(0, 2), rng.uniform(0.01, 1), rng.uniform(0.01, 0.2)
        v = stoppable(room, d, T)
        assert T * np.maximum(v - d * np.arange(1 + int(v / d) + 1), 0.0).sum() <= room + 1e-12
    assert stoppable(0.5, np.inf, 0.1) == 5.0 and stoppable(np.inf, 1.0, 0.1) == np.inf


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("ramp", [0.5, 1.0])
def test_a_closed_loop_keeps_the_accelerations_and_comes_where_it_planned(lwr4, late, ramp):
    """Commands at every millisecond; each plan's first stage is half a ramp after the end of its period."""
    problem = arm_problem(lwr4, ramp=ramp, delay_compensation=late, retreat=True)
    goal, q = target(problem, lwr4.home + 0.4), lwr4.home
    memory, fastest = at_rest(problem, q), 0.0
    for _ in range(30):
        memory = nmpc_step(problem, memory, q, goal, ObstaclePoints(), 0.0)
        assert memory.status == NmpcStatus.SOLVED
        times = np.linspace(0.0, 0.1, 101)
        u = np.array([ramped(memory.before, memory.command, 0.1 * ramp, t) for t in times])
        assert np.abs(np.diff(u, axis=0)).max() / 0.001 <= 3.0 * (1.0 + 1e-6)
        fastest = max(fastest, np.abs(u).max())
        q = advance(problem.data, q, ramp_mean(memory.before, memory.command, 0.1 * ramp, 0.1), 0.1)
        planned = advance(problem.data, q, memory.command, 0.05 * ramp)
        np.testing.assert_allclose(planned, memory.motion[1], atol=1e-9)
    assert fastest > 0.5
    assert np.linalg.norm(problem.end_effector_pose(q)[1] - goal.p_WE[0]) < 0.01


def test_braking_on_bad_input_keeps_the_accelerations(lwr4):
    problem = arm_problem(lwr4, ramp=0.5)
    goal, q, memory = target(problem, lwr4.home + 0.4), lwr4.home, at_rest(arm_problem(lwr4), lwr4.home)
    for _ in range(5):
        memory = nmpc_step(problem, memory, q, goal, ObstaclePoints(), 0.0)
        q = advance(problem.data, q, ramp_mean(memory.before, memory.command, 0.05, 0.1), 0.1)
    before = memory.command
    memory = nmpc_step(problem, memory, np.full(7, np.nan), goal, ObstaclePoints(), 0.0)
    assert memory.status == NmpcStatus.BAD_INPUT
    np.testing.assert_allclose(np.abs(memory.command - before).max(), 3.0 * 0.05)


def test_a_reference_is_met_in_time(lwr4):
    """A target that moves at constant speed is followed without lag, although commands are ramped."""
    problem = bench.benchmark_problem("1", ramp=1.0, acceleration_max=[1.0, 1.0, 1.0, *[5.0] * 7])
    q, R = bench.start(problem)
    memory = at_rest(problem, q)
    for k in range(60):
        memory = nmpc_step(problem, memory, q, bench.reference(R, 0.1 * k, 12), ObstaclePoints(), 0.0)
        q = advance(problem.data, q, ramp_mean(memory.before, memory.command, 0.1, 0.1), 0.1)
    error = problem.end_effector_pose(q)[1] - bench.reference(R, 6.0, 1).p_WE[0]
    assert np.linalg.norm(error) < 5e-4
