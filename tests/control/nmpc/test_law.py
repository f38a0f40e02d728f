"""Obstacles in the predictive control, term by term: (20), (21) with r_O, and the extent of an obstacle."""

import nmpc_problems as bench
import numpy as np
import pytest

from saphari_drake.control.nmpc.data import no_multipliers
from saphari_drake.control.nmpc.horizon import evaluate
from saphari_drake.control.nmpc.law import at_rest, nmpc_step, solve
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, NmpcStatus, TestPoint
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.rows import distance_rows, kept_distances
from saphari_drake.messages import ObstaclePoints

H = 1e-6
RADIUS = np.array([0.0, 0.02, 0.05, 0.01, 0.03, 0.04])


@pytest.fixture(scope="module")
def scene():
    """Arguments of the kernel for the benchmark's job before its obstacles, which have an extent here."""
    problem = bench.benchmark_problem("2")
    q0, R = bench.start(problem)
    q0 = q0 + np.array([0.0, 1.2] + [0.0] * 8)
    Q = q0 + 0.05 * np.random.default_rng(0).normal(size=(10, 10))
    return problem.scene(q0, bench.reference(R, 6.0, 11), bench.obstacles())._replace(radius=RADIUS), Q


def run(scene, Q=None, case="2", **changes):
    """Return what the kernel gives for the benchmark with some parameters changed."""
    data = bench.benchmark_problem(case, **changes).data
    given, here = scene
    return evaluate(data, given, here if Q is None else Q, no_multipliers(given, 10, 10), True, True)


def terms_20(scene, P):
    """Return F_O of (20) at every stage from 1 on, from the numbers of the benchmark alone; an extent adds to d_min."""
    d_min, c = np.array([row[3] for row in bench.POINTS]), np.array([row[4] for row in bench.POINTS])
    d = np.linalg.norm(P[1:, :, None] - scene[0].p_WO.swapaxes(1, 2)[1:, None], axis=3)
    margin = d**2 - (d_min[:, None] + RADIUS) ** 2
    assert margin.min() > NmpcParameters().barrier_guard, "the barrier is (20) itself here"
    return np.sum(c[:, None] / margin, axis=(1, 2))


@pytest.mark.parametrize("r_O", [0.0, 1.0, 2.0, 7.5])
def test_cost_is_20_at_every_stage_and_r_O_times_it_at_the_last(scene, r_O):
    """Eq. (18)–(21): what obstacles add to the cost."""
    at = run(scene, r_O=r_O)
    F = terms_20(scene, at.P)
    assert at.f - run(scene, case="1").f == pytest.approx(F[:-1].sum() + r_O * F[-1], rel=1e-9)
    assert F[-1] > 1e-2 * F.sum()


def test_r_O_pulls_the_last_stage_alone(scene):
    """What r_O adds to the gradient is r_O times that of F_O(q_N), by central differences; to other stages nothing."""
    g = run(scene, r_O=3.0).g - run(scene, r_O=0.0).g
    np.testing.assert_array_equal(g[:-1], 0.0)
    for j in range(10):
        D = np.zeros_like(scene[1])
        D[-1, j] = H
        up, down = (terms_20(scene, run(scene, scene[1] + sign * D).P)[-1] for sign in (1.0, -1.0))
        assert g[-1, j] == pytest.approx(3.0 * (up - down) / (2.0 * H), abs=1e-5 * np.abs(g).max())


def beside_the_wrist(robot, radius=0.0, **changes):
    """Return problem and scene: the arm turns past an obstacle near where its wrist should end."""
    points = [TestPoint("elbow", robot.link_names[3]), TestPoint("wrist", robot.link_names[5], [0.0, 0.0, 0.05])]
    values = {"horizon": 3, "tolerance": 1e-6, "between_samples": False} | changes
    problem = NmpcProblem(robot, robot.link_names[-1], points, NmpcParameters(**values))
    q0 = problem.data.home + np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    R, p = problem.end_effector_pose(problem.data.home)
    at = bench.test_points(problem, problem.data.home)[-1] - np.array([0.0, 0.19, 0.0])
    obstacle = ObstaclePoints(at[None], np.zeros((1, 3)), np.array([radius]), 0.0)
    reference = NmpcReference(p[None], R[None])
    return problem, problem.scene(q0, reference, obstacle)


def distances(problem, scene):
    """Return the wrist's distance from the obstacle at stages 1 … N of the solution."""
    solution = solve(problem, scene, np.tile(scene.q0, (problem.params.horizon, 1)))
    assert solution.status == NmpcStatus.SOLVED and solution.slack == 0.0
    return np.array([np.linalg.norm(bench.test_points(problem, q)[-1] - scene.p_WO[0, :, 0]) for q in solution.Q])


def test_a_larger_r_O_ends_the_plan_farther_away(lwr4):
    """A weight that grows lowers the term that it weighs."""
    last = [
        distances(*beside_the_wrist(lwr4, obstacle_constraints=False, r_O=r_O))[-1] for r_O in (0.0, 2.0, 8.0, 30.0)
    ]
    assert np.all(np.diff(last) > 1e-3)


def test_rows_are_22_with_the_extent_added_to_the_distance(scene):
    """z = d² − (d_min + radius)² of every stage, point and obstacle."""
    given, Q = scene
    data, at = bench.benchmark_problem("3").data, run(scene)
    rows = distance_rows(data, given, Q, at, kept_distances(data, given.q0, Q, at.J), np.inf, True)
    assert len(rows.z) == 10 * 10 * 6
    d = np.linalg.norm(at.P[rows.stage, rows.point] - given.p_WO[rows.stage, :, rows.obstacle], axis=1)
    np.testing.assert_allclose(rows.z, d**2 - (data.d_min[rows.point] + RADIUS[rows.obstacle]) ** 2, atol=1e-12)


@pytest.mark.parametrize("margin", [0.0, 0.02])
def test_the_plan_keeps_the_distance_and_the_extent_exactly(lwr4, margin):
    """Constraints alone hold the wrist at d_min + margin + radius: an obstacle larger by δ is kept δ farther away."""
    for radius in (0.0, 0.03, 0.06):
        problem, scene = beside_the_wrist(lwr4, radius, obstacle_cost=False, clearance_margin=margin)
        kept = problem.test_points[1].d_min + margin + radius
        assert distances(problem, scene).min() == pytest.approx(kept, abs=1e-5)


@pytest.mark.parametrize("speed", [-0.5, 0.3])
def test_an_obstacle_seen_before_is_where_it_has_come_since(lwr4, speed):
    """A step with what was seen `age` ago is that with the same obstacle seen now; the clearance is that from there."""
    problem, scene = beside_the_wrist(lwr4)
    q, age, v = scene.q0, 0.06, np.array([[0.0, speed, 0.0]])
    wrist = bench.test_points(problem, q)[-1]
    now = (wrist - np.array([0.0, problem.test_points[1].d_min + 0.08, 0.0]))[None]
    R, p = problem.end_effector_pose(problem.data.home)
    reference = NmpcReference(p[None], R[None])
    one, other = (
        nmpc_step(problem, at_rest(problem, q), q, reference, ObstaclePoints(place, v, np.zeros(1), 0.0), since)
        for place, since in ((now, 0.0), (now - age * v, age))
    )
    assert one.status == other.status == NmpcStatus.SOLVED
    np.testing.assert_allclose(other.command, one.command, atol=1e-9)
    assert other.clearance == pytest.approx(one.clearance, abs=1e-9) and one.clearance <= 0.08 + 1e-9
