"""The SQP against SNOPT, IPOPT and an independent model of the same problem; parameters and problem data."""

import itertools

import nmpc_problems as bench
import numpy as np
import pytest
from arms import joint, link, write_urdf
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.control.nmpc.data import no_multipliers
from saphari_drake.control.nmpc.horizon import evaluate
from saphari_drake.control.nmpc.law import solve
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, NmpcStatus, TestPoint
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.solvers.program import HorizonProgram
from saphari_drake.control.nmpc.solvers.sqp import SqpOptions, solve_sqp, solve_sqp_within
from saphari_drake.errors import ModelError, ParameterError, UnknownNameError
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots.model import RobotModel


def arm_problem(robot, **changes):
    """Return a short problem of an arm with two test points."""
    points = [TestPoint("elbow", robot.link_names[3]), TestPoint("wrist", robot.link_names[5], [0.0, 0.0, 0.05])]
    values = {"horizon": 3, "tolerance": 1e-6, "between_samples": False} | changes
    return NmpcProblem(robot, robot.link_names[-1], points, NmpcParameters(**values))


def random_scene(problem, seed, count=2):
    """Return a step with a reachable target and obstacles close to the wrist."""
    rng = np.random.default_rng(seed)
    q0 = problem.data.home + rng.uniform(-0.3, 0.3, problem.n)
    R, p = problem.end_effector_pose(q0 + rng.uniform(-0.2, 0.2, problem.n))
    P = bench.test_points(problem, q0)
    away = rng.normal(size=(count, 3))
    away *= rng.uniform(1.05, 1.4, (count, 1)) * 0.2 / np.linalg.norm(away, axis=1)[:, None]
    away[:, 2] = np.abs(away[:, 2])
    points = P[-1] + away
    clear = np.linalg.norm(points[:, None] - P, axis=2).min(axis=1) > 0.205
    obstacles = ObstaclePoints(points[clear], np.zeros((clear.sum(), 3)), np.zeros(clear.sum()), 0.0)
    return problem.scene(q0, NmpcReference(p[None], R[None]), obstacles)


@pytest.mark.parametrize("seed", range(10))
def test_solution_is_that_of_snopt(lwr4, seed):
    """Ten random problems, barrier and constraints on or constraints alone: same minimum of the same program."""
    problem = arm_problem(lwr4, obstacle_cost=seed % 2 == 0)
    scene = random_scene(problem, seed)
    guess = np.tile(scene.q0, (3, 1))
    own = solve(problem, scene, guess)
    expected = solve(arm_problem(lwr4, obstacle_cost=seed % 2 == 0, solver="snopt"), scene, guess)
    assert own.status == expected.status == NmpcStatus.SOLVED
    np.testing.assert_allclose(own.Q, expected.Q, atol=2e-5)


@pytest.mark.parametrize("solver", ["daqp", "ipopt"])
def test_other_solvers_give_the_same_solution(lwr4, solver, capfd):
    """And none prints."""
    for seed in (0, 1, 3, 4):
        scene = random_scene(arm_problem(lwr4), seed)
        guess = np.tile(scene.q0, (3, 1))
        expected = solve(arm_problem(lwr4, obstacle_cost=seed % 2 == 0), scene, guess)
        found = solve(arm_problem(lwr4, obstacle_cost=seed % 2 == 0, solver=solver), scene, guess)
        assert found.status == NmpcStatus.SOLVED
        np.testing.assert_allclose(found.Q, expected.Q, atol=1e-4)
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("mode", ["converged", "real_time"])
@pytest.mark.parametrize("solver", ["active_set", "daqp"])
def test_limits_that_contradict_each_other_are_unsolved(lwr4, solver, mode):
    """Also in one iteration: never a result that passes for one. No parameters lead there, so the data are changed."""
    problem = arm_problem(lwr4, solver=solver, mode=mode)
    scene = random_scene(problem, 0)
    guess = np.tile(scene.q0, (3, 1))
    assert solve(problem, scene, guess).status in (NmpcStatus.SOLVED, NmpcStatus.REAL_TIME)
    problem.data = problem.data._replace(v_max=-problem.data.v_max)
    found = solve(problem, scene, guess)
    assert found.status == NmpcStatus.UNSOLVED and found.iterations == 1


@pytest.mark.parametrize("solver", ["snopt", "ipopt"])
def test_distances_out_of_reach_are_unsolved_where_they_are_hard(lwr4, solver):
    """An obstacle in the wrist: the SQP has slack for it, the whole program has none."""
    slow = {"obstacle_cost": False, "velocity_scale": [0.1]}
    problem = arm_problem(lwr4, solver=solver, **slow)
    q, wrist = lwr4.home, bench.test_points(problem, lwr4.home)[1:] + 0.02
    R, p = problem.end_effector_pose(q)
    scene = problem.scene(q, NmpcReference(p[None], R[None]), bench.obstacles(wrist))
    assert solve(problem, scene, np.tile(q, (3, 1))).status == NmpcStatus.UNSOLVED
    soft = solve(arm_problem(lwr4, **slow), scene, np.tile(q, (3, 1)))
    assert soft.status != NmpcStatus.UNSOLVED and soft.slack > 0.0


@pytest.mark.parametrize("solver", ["active_set", "daqp", "snopt", "ipopt"])
def test_numbers_that_are_not_finite_are_not_solved(lwr4, solver):
    """A reference that is NaN makes gradient and Hessian NaN."""
    problem = arm_problem(lwr4, solver=solver)
    scene = random_scene(problem, 0)
    scene.p_ref[:] = np.nan
    found = solve(problem, scene, np.tile(scene.q0, (3, 1)))
    assert found.status in (NmpcStatus.UNSOLVED, NmpcStatus.UNCONVERGED)
    assert found.status == NmpcStatus.UNSOLVED or problem.program is not None


@pytest.mark.parametrize("solver", ["active_set", "daqp", "snopt", "ipopt"])
def test_iterations_that_do_not_suffice_are_told(lwr4, solver):
    problem = arm_problem(lwr4, solver=solver, tolerance=1e-12, max_iterations=2)
    if problem.program is not None:
        problem.program = HorizonProgram(problem.data, 3, solver, iterations=1)
    scene = random_scene(problem, 0)
    found = solve(problem, scene, np.tile(scene.q0, (3, 1)))
    assert found.status == NmpcStatus.UNCONVERGED and np.all(np.isfinite(found.Q))


def test_the_program_costs_what_the_kernel_says(lwr4):
    """Each term is a cost of its own that a user can look at; together they are the kernel's cost."""
    problem = arm_problem(lwr4, solver="snopt")
    scene = random_scene(problem, 2)
    Q = scene.q0 + 0.02 * np.random.default_rng(0).normal(size=(3, 7))
    build = problem.program
    build.update(scene)
    build.program.SetInitialGuess(build.q, Q)
    costs = build.program.GetAllCosts()
    total = sum(build.program.EvalBindingAtInitialGuess(cost)[0] for cost in costs)
    f = evaluate(problem.data, scene, Q, no_multipliers(scene, 3, 2), False, True).f
    assert total == pytest.approx(f, rel=1e-12)
    names = {cost.evaluator().get_description().split()[0] for cost in costs}
    assert names == {"velocity", "posture", "pose", "obstacles"}


def test_a_program_is_the_same_whatever_it_solved_before(lwr4):
    """Steps with one obstacle, none and two, in turn: each as by a program that solves it first."""
    used = arm_problem(lwr4, solver="snopt")
    for seed, count in ((0, 1), (1, 0), (2, 2), (0, 1)):
        scene = random_scene(used, seed, count)
        guess = np.tile(scene.q0, (3, 1))
        fresh = solve(arm_problem(lwr4, solver="snopt"), scene, guess)
        np.testing.assert_array_equal(solve(used, scene, guess).Q, fresh.Q)


@pytest.mark.parametrize("case", ["2", "3", "3h"])
def test_benchmark_steps_equal_ipopt_on_an_independent_model(case):
    """CasADi's problem, from the DH table alone: the velocity applied within 1e-3 of its norm."""
    pytest.importorskip("casadi")
    from nmpc_peer import CasadiPeer

    problem = bench.benchmark_problem(case)
    q, R = bench.start(problem)
    peer = CasadiPeer(problem.robot, case, R)
    Q = np.tile(q, (10, 1))
    obstacles = bench.obstacles()
    for step in range(140):
        scene, guess = problem.scene(q, bench.reference(R, 0.1 * step, 11), obstacles), np.vstack([Q[1:], Q[-1:]])
        solution = solve(problem, scene, guess)
        assert solution.status == NmpcStatus.SOLVED and solution.slack == 0.0
        own = (solution.Q[0] - q) / problem.params.period
        assert np.all(np.abs(own) <= problem.data.v_max * (1.0 + 1e-9))
        if step in (1, 60, 110, 125, 139):
            expected, ok = peer.solve(q, scene.p_ref, guess)
            v = (expected[0] - q) / problem.params.period
            assert ok and np.linalg.norm(own - v) <= 1e-3 * np.linalg.norm(v)
        Q, q = solution.Q, solution.Q[0]


def test_limits_hold_at_every_stage(lwr4):
    """A target out of reach: velocities at their limits, never beyond; a start beyond a limit may stay there."""
    problem = arm_problem(lwr4, horizon=8)
    q0 = lwr4.q_max - 0.02
    q0[0] = lwr4.q_max[0] + 0.01
    R, p = np.eye(3)[None], np.array([[3.0, 0.0, 3.0]])
    scene = problem.scene(q0, NmpcReference(p, R), ObstaclePoints())
    Q = solve(problem, scene, np.tile(q0, (8, 1))).Q
    v = np.diff(np.vstack([q0, Q]), axis=0) / 0.1
    assert np.all(np.abs(v) <= problem.data.v_max + 1e-8) and np.any(np.abs(v) > problem.data.v_max - 1e-8)
    assert np.all(Q <= np.maximum(lwr4.q_max, q0) + 1e-8) and np.all(Q >= lwr4.q_min - 1e-8)


def test_a_constraint_that_cannot_hold_costs_slack(lwr4):
    """An obstacle that comes faster than the arm can yield: the least violation, reported as a length."""
    problem = arm_problem(lwr4, velocity_scale=[0.3])
    scene = random_scene(problem, 0, 1)
    wrist = bench.test_points(problem, scene.q0)[1]
    way = np.vstack([wrist + 0.5, np.tile(wrist + 0.02, (3, 1))])[:, :, None]
    moved = scene._replace(p_WO=way, radius=np.zeros(1))
    solution = solve(problem, moved, np.tile(scene.q0, (3, 1)))
    assert np.all(np.isfinite(solution.Q))
    assert 0.01 < solution.slack < 0.2


def test_after_a_deadline_no_iteration_begins(lwr4):
    """One at least; as many as fit before it; with time enough the same solution as without."""
    problem = arm_problem(lwr4)
    scene, ticks = random_scene(problem, 0), itertools.count()
    guess, options = np.tile(scene.q0, (problem.N, 1)), SqpOptions(30, 1e-4, 1e4, True)
    whole = solve_sqp(problem.data, scene, guess, options)
    assert whole.solved > 2
    given = {t: solve_sqp_within(problem.data, scene, guess, options, t, lambda: next(ticks)) for t in (0.0, 2.0, 1e9)}
    assert [at.solved for at in given.values()] == [1, 2, whole.solved]
    np.testing.assert_array_equal(given[1e9].Q, whole.Q)
    problem.params.deadline = 1e-9
    assert solve(problem, scene, guess).iterations == 1
    assert solve(problem, scene, guess).status == NmpcStatus.UNCONVERGED


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
        scene = problem.scene(q, NmpcReference(p[None], R[None]), obstacle)
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
    with pytest.raises((ParameterError, UnknownNameError), match=next(iter(change))):
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
