"""The horizon kernel against Drake's own plant and finite differences; distance rows against the motion they bound."""

import nmpc_problems as bench
import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from saphari_drake.control.nmpc.data import no_multipliers
from saphari_drake.control.nmpc.horizon import evaluate
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, TestPoint
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.rows import distance_rows, kept_distances, reachable, slip_rows
from saphari_drake.messages import ObstaclePoints

H = 1e-6


@pytest.fixture(scope="module", params=[0.0, 0.1], ids=["quadratic", "linear"])
def scene(request):
    """The benchmark's problem near its obstacles, with an iterate off the reference, for both costs of the pose."""
    problem = bench.benchmark_problem("3", pull_linear=[request.param])
    q0, R = bench.start(problem)
    q0 = q0 + np.array([0.0, 2.2] + [0.0] * 8)
    Q = q0 + 0.05 * np.random.default_rng(0).normal(size=(10, 10))
    return problem.data, problem.scene(q0, bench.reference(R, 11.0, 11), bench.obstacles()), Q


def run(scene, Q, exact=True, multipliers=None, derivatives=True):
    data, given, _ = scene
    multipliers = no_multipliers(given, 10, 10) if multipliers is None else multipliers
    return evaluate(data, given, Q, multipliers, exact, derivatives)


def all_rows(data, given, Q, step=np.inf, everything=True):
    """Return the rows at an iterate, and the distances that they keep."""
    at = evaluate(data, given, Q, no_multipliers(given, len(Q), len(data.d_min)), True, True)
    kept = kept_distances(data, given.q0, Q, at.J)
    return distance_rows(data, given, Q, at, kept, step, everything), kept


@pytest.mark.parametrize("name", ["lwr4", "panda", "xarm7", "mobile"])
def test_points_and_jacobians_equal_those_of_the_plant(load_arm, name):
    """At random postures, for any robot and base, to 1e-12."""
    robot = load_arm(name)
    rng = np.random.default_rng(1)
    points = [TestPoint(str(i), link, rng.uniform(-0.3, 0.3, 3).tolist()) for i, link in enumerate(robot.link_names)]
    problem = NmpcProblem(robot, robot.link_names[-1], points, NmpcParameters(horizon=1))
    plant = MultibodyPlant(0.0)
    instance = robot.add_to(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for q in rng.uniform(-2.0, 2.0, (5, robot.n)):
        given = problem.scene(q, bench.reference(np.eye(3), 0.0, 1), ObstaclePoints())
        *_, P, J = evaluate(problem.data, given, q[None], no_multipliers(given, 1, len(points)), True, True)
        plant.SetPositions(context, instance, q)
        for i, point in enumerate(points):
            frame, world = plant.GetFrameByName(point.frame), plant.world_frame()
            expected = plant.CalcPointsPositions(context, frame, point.p_FC, world).ravel()
            np.testing.assert_allclose(P[1, i], expected, atol=1e-12)
            wrt = JacobianWrtVariable.kQDot
            expected = plant.CalcJacobianTranslationalVelocity(context, wrt, frame, point.p_FC, world, world)
            np.testing.assert_allclose(J[1, i].T, expected, atol=1e-12)


def test_gradient_is_that_of_the_cost(scene):
    """Central differences; the same value with and without derivatives."""
    Q = scene[2]
    f, g, *_ = run(scene, Q)
    assert run(scene, Q, derivatives=False)[0] == pytest.approx(f, rel=1e-14)
    for k, j in np.ndindex(Q.shape):
        D = np.zeros_like(Q)
        D[k, j] = H
        difference = (run(scene, Q + D, derivatives=False)[0] - run(scene, Q - D, derivatives=False)[0]) / (2 * H)
        assert g[k, j] == pytest.approx(difference, abs=1e-5 * np.abs(g).max())


def test_exact_hessian_is_that_of_the_cost(scene):
    """Central differences of the gradient, block by block."""
    Q = scene[2]
    exact = run(scene, Q)[2]
    for k, j in np.ndindex(Q.shape):
        D = np.zeros_like(Q)
        D[k, j] = H
        difference = (run(scene, Q + D)[1] - run(scene, Q - D)[1])[k] / (2 * H)
        np.testing.assert_allclose(exact[k, j], difference, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("pull", [0.0, 0.02])
def test_gauss_newton_hessian_is_exact_where_the_pose_error_vanishes(pull):
    """Without obstacles and on the reference both agree; off it only the Gauss–Newton one must be semidefinite."""
    problem = bench.benchmark_problem("1", pull_linear=[pull])
    q, _ = bench.start(problem)
    R, p = problem.end_effector_pose(q)
    given, Q = problem.scene(q, NmpcReference(p[None], R[None]), ObstaclePoints()), np.tile(q, (10, 1))
    both = [run((problem.data, given, Q), Q, exact).H for exact in (True, False)]
    np.testing.assert_allclose(both[0], both[1], atol=1e-10)
    off = run((problem.data, given, Q), Q + 0.3, False).H
    assert min(np.linalg.eigvalsh(block)[0] for block in off) > -1e-10


def test_multipliers_bend_the_hessian_only_off_the_constraint(scene):
    """On the tangent of a row, what its multiplier adds to the Hessian is −λ∇²z, by finite differences of ∇z."""
    data, given, Q = scene
    one = no_multipliers(given, 10, 10)
    one[4, 6, 2] = 3.0
    added = (run(scene, Q, multipliers=one).H - run(scene, Q).H)[3]

    def gradient(Q):
        rows, _ = all_rows(data, given, Q)
        (r,) = np.nonzero((rows.stage == 4) & (rows.point == 6) & (rows.obstacle == 2))[0]
        return rows.b[r]

    curvature = np.empty((10, 10))
    for j in range(10):
        D = np.zeros_like(Q)
        D[3, j] = H
        curvature[j] = (gradient(Q + D) - gradient(Q - D)) / (2 * H)
    a = gradient(Q)
    T = np.linalg.svd(a[None])[2][1:]
    np.testing.assert_allclose(T @ added @ T.T, -3.0 * T @ curvature @ T.T, atol=1e-7)
    assert a @ added @ a > 0.0


@pytest.mark.parametrize("between", [False, True])
def test_rows_are_the_gradients_of_their_distances(scene, between):
    """Central differences in both stages of a row; the distance to keep, which grows with the speed, held fixed."""
    _, given, Q = scene
    data = bench.benchmark_problem("3", between_samples=between).data
    rng = np.random.default_rng(2)
    moving = np.linspace(0.0, 1.0, 11)[:, None, None] * rng.normal(size=(1, 6, 3))
    given = given._replace(p_WO=given.p_WO + moving.swapaxes(1, 2))

    def rows(Q):
        rows, kept = all_rows(data, given, Q)
        return rows, rows.z + np.square(kept[rows.stage, rows.point])

    here, _ = rows(Q)
    D = rng.normal(size=Q.shape)
    difference = (rows(Q + H * D)[1] - rows(Q - H * D)[1]) / (2 * H)
    before = np.vstack([np.zeros(10), D])[here.stage - 1]
    slope = np.sum(here.a * before, axis=1) + np.sum(here.b * D[here.stage - 1], axis=1)
    np.testing.assert_allclose(slope, difference, atol=1e-5 * np.abs(difference).max())


@pytest.mark.parametrize("between", [False, True])
@pytest.mark.parametrize("step", [0.02, 0.15, np.inf])
def test_rows_left_out_hold_for_every_step_within_the_limits(scene, between, step):
    """Random steps, and those that go farthest against each row, within the box that the proof states."""
    _, given, _ = scene
    data = bench.benchmark_problem("3", between_samples=between).data
    rng = np.random.default_rng(3)
    boxes = [reachable(data, given.q0, k + 1) for k in range(10)]
    Q = np.array([rng.uniform(*box) for box in boxes])
    Q = 0.2 * Q + 0.8 * given.q0
    every, _ = all_rows(data, given, Q, step)
    near, _ = all_rows(data, given, Q, step, everything=False)
    kept = set(zip(near.stage, near.point, near.obstacle))
    left = [r for r, key in enumerate(zip(every.stage, every.point, every.obstacle)) if key not in kept]
    assert left and len(left) + len(near.z) == len(every.z)
    low = np.maximum(np.array([box[0] for box in boxes]) - Q, -step)
    high = np.minimum(np.array([box[1] for box in boxes]) - Q, step)
    for r in left:
        k = every.stage[r] - 1
        worst = every.z[r] + np.minimum(every.b[r] * low[k], every.b[r] * high[k]).sum()
        if k > 0:
            worst += np.minimum(every.a[r] * low[k - 1], every.a[r] * high[k - 1]).sum()
        assert worst >= 0.0 or not (every.a[r].any() or every.b[r].any())


def test_a_swept_row_bounds_the_distance_at_every_instant():
    """Where z ≥ 0, the way between two samples stays at least d_min from an obstacle that moves."""
    problem = bench.benchmark_problem("3h", between_samples=True, horizon=1)
    data, rng, tight = problem.data, np.random.default_rng(4), np.inf
    for _ in range(200):
        q0 = bench.HOME + rng.uniform(-0.5, 0.5, 10)
        q1 = q0 + rng.uniform(-0.1, 0.1, 10) * data.v_max
        paths = np.array([bench.test_points(problem, q0 + s * (q1 - q0)) for s in np.linspace(0.0, 1.0, 51)])
        given = problem.scene(q0, bench.reference(np.eye(3), 0.0, 1), bench.obstacles(np.zeros((1, 3))))
        for i in (0, 6, 9):
            away = rng.normal(size=3)
            o = paths[25, i] + away / np.linalg.norm(away) * rng.uniform(0.9, 1.2) * data.d_min[i]
            ends = o + np.array([-0.05, 0.05])[:, None] * rng.normal(size=3)
            rows, _ = all_rows(data, given._replace(p_WO=ends[:, :, None]), q1[None])
            z = rows.z[rows.point == i][0]
            obstacle = ends[0] + np.linspace(0.0, 1.0, 51)[:, None] * (ends[1] - ends[0])
            smallest = np.linalg.norm(paths[:, i] - obstacle, axis=1).min()
            if z >= 0.0:
                assert smallest >= data.d_min[i]
                tight = min(tight, smallest - data.d_min[i])
    assert tight < 0.005


def test_an_arc_has_no_slip_at_its_chord():
    """The slip rows vanish on exact arcs and nowhere sideways, with exact gradients."""
    problem = bench.benchmark_problem("1", nonholonomic=["px", "py", "pz"])
    q0 = bench.HOME + 0.3
    theta = q0[2] + 0.06 * np.arange(1, 11)
    Q = np.tile(q0, (10, 1))
    Q[:, 2] = theta
    Q[:, 0] = q0[0] + 2.0 * (np.sin(theta) - np.sin(q0[2]))
    Q[:, 1] = q0[1] - 2.0 * (np.cos(theta) - np.cos(q0[2]))
    rows = slip_rows(problem.data, q0, Q)
    np.testing.assert_allclose(rows.z, 0.0, atol=1e-14)
    D = np.random.default_rng(5).normal(size=Q.shape)
    difference = (slip_rows(problem.data, q0, Q + H * D).z - slip_rows(problem.data, q0, Q - H * D).z) / (2 * H)
    before = np.vstack([np.zeros(10), D])[:-1]
    np.testing.assert_allclose(np.sum(rows.a * before + rows.b * D, axis=1), difference, atol=1e-8)
