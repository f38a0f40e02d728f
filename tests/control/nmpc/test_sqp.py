"""The SQP against SNOPT, IPOPT and an independent model of the same problem; parameters and problem data."""

import nmpc_problems as bench
import numpy as np
import pytest
from arms import joint, link, write_urdf
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.control.nmpc.horizon import evaluate, no_multipliers
from saphari_drake.control.nmpc.problem import NmpcParameters, NmpcProblem, TestPoint
from saphari_drake.control.nmpc.program import build_program, solve_program
from saphari_drake.control.nmpc.sqp import make_scene, solve
from saphari_drake.errors import ModelError, ParameterError, UnknownNameError
from saphari_drake.messages import NmpcReference, NmpcStatus, ObstaclePoints
from saphari_drake.robots.model import RobotModel


def arm_problem(robot, **changes):
    """Return a short problem of an arm with two test points."""
    points = [TestPoint("elbow", robot.link_names[3]), TestPoint("wrist", robot.link_names[5], [0.0, 0.0, 0.05])]
    values = {"horizon": 3, "tolerance": 1e-6, "between_samples": False} | changes
    return NmpcProblem(robot, robot.link_names[-1], points, NmpcParameters(**values))


def random_scene(problem, seed, count=2):
    """Return a step with a reachable target and obstacles close to the wrist."""
    rng = np.random.default_rng(seed)
    q0 = problem.home + rng.uniform(-0.3, 0.3, problem.n)
    R, p = problem.end_effector_pose(q0 + rng.uniform(-0.2, 0.2, problem.n))
    *_, P, _ = evaluate(
        problem.data, q0, q0[None], R[None].repeat(2, 0), p[None].repeat(2, 0), np.zeros((2, 0, 3)), np.zeros(0),
        no_multipliers(), False, False,
    )  # fmt: skip
    away = rng.normal(size=(count, 3))
    away *= rng.uniform(1.05, 1.4, (count, 1)) * 0.2 / np.linalg.norm(away, axis=1)[:, None]
    away[:, 2] = np.abs(away[:, 2])
    points = P[0, -1] + away
    clear = np.linalg.norm(points[:, None] - P[0], axis=2).min(axis=1) > 0.205
    obstacles = ObstaclePoints(points[clear], np.zeros((clear.sum(), 3)), np.zeros(clear.sum()), 0.0)
    return make_scene(problem, q0, *problem.stages(NmpcReference(p[None], R[None])), *problem.predict(obstacles))


@pytest.mark.parametrize("seed", range(10))
def test_solution_is_that_of_snopt(lwr4, seed):
    """Ten random problems, barrier and constraints on or constraints alone: same minimum of the same program."""
    problem = arm_problem(lwr4, obstacle_cost=seed % 2 == 0)
    scene = random_scene(problem, seed)
    guess = np.tile(scene.q0, (3, 1))
    own = solve(problem, scene, guess)
    expected, ok = solve_program(build_program(problem, *scene), guess, "snopt")
    assert ok and own.status == NmpcStatus.SOLVED
    np.testing.assert_allclose(own.Q, expected, atol=2e-5)


def test_ipopt_agrees(lwr4):
    problem = arm_problem(lwr4, solver="ipopt")
    scene = random_scene(problem, 4)
    guess = np.tile(scene.q0, (3, 1))
    expected = solve(arm_problem(lwr4), scene, guess)
    np.testing.assert_allclose(solve(problem, scene, guess).Q, expected.Q, atol=1e-4)


@pytest.mark.parametrize("qp_solver", ["daqp", "osqp", "clarabel"])
def test_other_qp_solvers_give_the_same_solution(lwr4, qp_solver, capfd):
    """And none prints."""
    for seed in (0, 1, 3):
        scene = random_scene(arm_problem(lwr4), seed)
        guess = np.tile(scene.q0, (3, 1))
        expected = solve(arm_problem(lwr4, obstacle_cost=seed == 0), scene, guess)
        found = solve(arm_problem(lwr4, obstacle_cost=seed == 0, qp_solver=qp_solver, tolerance=1e-4), scene, guess)
        assert found.status == NmpcStatus.SOLVED
        np.testing.assert_allclose(found.Q, expected.Q, atol=3e-4)
    assert capfd.readouterr().out == ""


def test_the_program_costs_what_the_kernel_says(lwr4):
    """Each term is a cost of its own that a user can look at; together they are the kernel's cost."""
    problem = arm_problem(lwr4)
    scene = random_scene(problem, 2)
    Q = scene.q0 + 0.02 * np.random.default_rng(0).normal(size=(3, 7))
    build = build_program(problem, *scene)
    build.program.SetInitialGuess(build.q, Q)
    costs = build.program.GetAllCosts()
    total = sum(build.program.EvalBindingAtInitialGuess(cost)[0] for cost in costs)
    f = evaluate(problem.data, *scene[:1], Q, *scene[1:], no_multipliers(), False, True)[0]
    assert total == pytest.approx(f, rel=1e-12)
    names = {cost.evaluator().get_description().split()[0] for cost in costs}
    assert names == {"velocity", "posture", "pose", "obstacles"}


@pytest.mark.parametrize("case", ["2", "3", "3h"])
def test_benchmark_steps_equal_ipopt_on_an_independent_model(case):
    """CasADi's problem, from the DH table alone: the velocity applied within 1e-3 of its norm."""
    pytest.importorskip("casadi")
    from nmpc_peer import CasadiPeer

    problem = bench.benchmark_problem(case)
    q, R = bench.start(problem)
    peer = CasadiPeer(problem.robot, case, R)
    Q = np.tile(q, (10, 1))
    obstacles = problem.predict(bench.obstacles())
    for step in range(140):
        R_ref, p_ref = problem.stages(bench.reference(R, 0.1 * step, 11))
        guess = np.vstack([Q[1:], Q[-1:]])
        solution = solve(problem, make_scene(problem, q, R_ref, p_ref, *obstacles), guess)
        assert solution.status == NmpcStatus.SOLVED and solution.slack == 0.0
        assert np.all(np.abs(solution.v) <= problem.v_max * (1.0 + 1e-9))
        if step in (1, 60, 110, 125, 139):
            expected, ok = peer.solve(q, p_ref, guess)
            v = (expected[0] - q) / problem.params.period
            assert ok and np.linalg.norm(solution.v - v) <= 1e-3 * np.linalg.norm(v)
        Q, q = solution.Q, solution.Q[0]


def test_limits_hold_at_every_stage(lwr4):
    """A target out of reach: velocities at their limits, never beyond; a start beyond a limit may stay there."""
    problem = arm_problem(lwr4, horizon=8)
    q0 = lwr4.q_max - 0.02
    q0[0] = lwr4.q_max[0] + 0.01
    R, p = np.eye(3)[None], np.array([[3.0, 0.0, 3.0]])
    scene = make_scene(problem, q0, *problem.stages(NmpcReference(p, R)), *problem.predict(ObstaclePoints()))
    Q = solve(problem, scene, np.tile(q0, (8, 1))).Q
    v = np.diff(np.vstack([q0, Q]), axis=0) / 0.1
    assert np.all(np.abs(v) <= problem.v_max + 1e-8) and np.any(np.abs(v) > problem.v_max - 1e-8)
    assert np.all(Q <= np.maximum(lwr4.q_max, q0) + 1e-8) and np.all(Q >= lwr4.q_min - 1e-8)


def test_a_constraint_that_cannot_hold_costs_slack(lwr4):
    """An obstacle that comes faster than the arm can yield: the least violation, reported as a length."""
    problem = arm_problem(lwr4, velocity_scale=[0.3])
    scene = random_scene(problem, 0, 1)
    *_, P, _ = evaluate(problem.data, *scene[:1], np.tile(scene.q0, (3, 1)), *scene[1:], no_multipliers(), False, False)
    way = np.vstack([P[0, 1] + 0.5, np.tile(P[0, 1] + 0.02, (3, 1))])[:, None]
    moved = scene._replace(p_WO=way, radius=np.zeros(1))
    solution = solve(problem, moved, np.tile(scene.q0, (3, 1)))
    assert np.all(np.isfinite(solution.Q))
    assert 0.01 < solution.slack < 0.2


def test_one_iteration_is_a_real_time_step(lwr4):
    problem = arm_problem(lwr4, mode="real_time")
    scene = random_scene(problem, 0)
    solution = solve(problem, scene, np.tile(scene.q0, (3, 1)))
    assert solution.iterations == 1 and solution.status == NmpcStatus.REAL_TIME


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_other_arms_need_no_change_of_code(load_arm, name):
    """A whole motion to a pose with an arm of example-robot-data, past an obstacle near its wrist."""
    robot = load_arm(name)
    n = robot.n
    home = np.clip(np.linspace(0.3, 0.6, n), robot.q_min + 0.3, robot.q_max - 0.3)
    points = [TestPoint(f, f, d_min=0.08) for f in robot.link_names[2:]]
    problem = NmpcProblem(robot, robot.link_names[6], points, NmpcParameters(home=home.tolist()))
    goal = home + np.where(np.arange(n) < 7, 0.25, 0.0)
    R, p = problem.end_effector_pose(goal)
    obstacle = ObstaclePoints(p[None] + np.array([0.0, 0.0, 0.4]), np.zeros((1, 3)), np.zeros(1), 0.0)
    q, Q = home, np.tile(home, (10, 1))
    for _ in range(30):
        scene = make_scene(problem, q, *problem.stages(NmpcReference(p[None], R[None])), *problem.predict(obstacle))
        Q = solve(problem, scene, np.vstack([Q[1:], Q[-1:]])).Q
        q = Q[0]
    found = problem.end_effector_pose(q)
    np.testing.assert_allclose(found[1], p, atol=0.01)
    np.testing.assert_allclose(found[0], R, atol=0.03)


@pytest.mark.parametrize(
    "change",
    [
        {"horizon": 0}, {"Q_v": [-1.0]}, {"Q_e": [1, 1, 1, 1, 1, -1.0]}, {"R_q": [float("nan")]}, {"r_O": -1.0},
        {"mode": "fast"}, {"solver": "magic"}, {"velocity_scale": [2.0]}, {"nonholonomic": ["x"]}, {"period": 0.0},
    ],
)  # fmt: skip
def test_parameters_are_checked(change):
    with pytest.raises((ParameterError, UnknownNameError), match=next(iter(change)).replace("solver", "solver")):
        NmpcParameters(**change)


def test_parameters_survive_yaml():
    params = NmpcParameters(Q_v=[0.2], mode="real_time", nonholonomic=["px", "py", "pz"])
    assert yaml_load_typed(schema=NmpcParameters, data=yaml_dump_typed(params)) == params


def test_problem_names_what_is_wrong(lwr4, tmp_path):
    """Unknown frames, weights of a wrong size, fixed frames, and joints without a velocity limit."""
    with pytest.raises(UnknownNameError, match="nowhere"):
        NmpcProblem(lwr4, "nowhere", [])
    with pytest.raises(UnknownNameError, match="nowhere"):
        NmpcProblem(lwr4, "link_7", [TestPoint("a", "nowhere")])
    with pytest.raises(ParameterError, match="Q_v"):
        NmpcProblem(lwr4, "link_7", [], NmpcParameters(Q_v=[1.0, 2.0]))
    with pytest.raises(ParameterError, match="d_min"):
        TestPoint("a", "link_7", d_min=0.0)
    free = joint("j", "base", "arm").replace('velocity="3"', 'velocity="0"')
    robot = RobotModel(write_urdf(tmp_path, link("base"), link("arm"), free, name="free"))
    with pytest.raises(ModelError, match="velocity limit"):
        NmpcProblem(robot, "arm", [])
    with pytest.raises(ModelError, match="does not move"):
        NmpcProblem(lwr4, lwr4_base(lwr4), [])


def lwr4_base(robot):
    """Return a frame of the robot that is fixed to the world."""
    return next(name for name, (index, _) in robot._frames.items() if index < 0)
