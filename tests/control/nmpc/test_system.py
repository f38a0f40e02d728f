"""The controller as a system: closed loops at 1 ms, what it does about bad input, ports and Context."""

import bench as benches
import nmpc_problems as bench
import numpy as np
import pytest

from saphari_drake.control.nmpc.kinematics import advance, command_to, joint_velocity
from saphari_drake.control.nmpc.law import at_rest, brake, nmpc_step
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, NmpcStatus, TestPoint
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.system import NmpcController
from saphari_drake.messages import ObstaclePoints, ObstacleStatus

POINTS = [TestPoint("elbow", "link_4"), TestPoint("wrist", "link_6"), TestPoint("hand", "link_7")]


def arm_problem(robot, **changes):
    return NmpcProblem(robot, "link_7", POINTS, NmpcParameters(**changes))


def at(points, v=(0.0, 0.0, 0.0), **others):
    """Return obstacle points with one velocity."""
    p = np.atleast_2d(np.array(points, dtype=float))
    return ObstaclePoints(p, np.tile(np.array(v, dtype=float), (len(p), 1)), np.zeros(len(p)), 0.0, **others)


def target(problem, q):
    R, p = problem.end_effector_pose(q)
    return NmpcReference(p[None], R[None])


def smallest_clearance(problem, q, memory, obstacles, age, count=100):
    """Return the smallest clearance at every millisecond of the period that begins."""
    smallest = np.inf
    for t in np.linspace(0.0, problem.params.period, count + 1):
        P = bench.test_points(problem, advance(problem.data, q, memory.command, t))
        O = obstacles.p_WO + (age + t) * obstacles.v_WO
        d = np.linalg.norm(P[:, None] - O, axis=2) - obstacles.radius
        smallest = min(smallest, (d - [[p.d_min] for p in problem.test_points]).min(initial=np.inf))
    return smallest


def closed_loop(problem, q, reference, obstacles, steps, check=True):
    """Run an exact velocity integrator; return positions, memories and the smallest clearance at 1 ms."""
    memory, ways, memories, clearance = at_rest(problem, q), [q], [], np.inf
    for k in range(steps):
        memory = nmpc_step(problem, memory, q, reference, obstacles, problem.params.period * k)
        assert np.all(np.isfinite(memory.command))
        assert np.all(np.abs(joint_velocity(problem.data, q, memory.command)) <= problem.data.v_max + 1e-9)
        if check:
            clearance = min(clearance, smallest_clearance(problem, q, memory, obstacles, problem.params.period * k))
        q = advance(problem.data, q, memory.command, problem.params.period)
        ways.append(q)
        memories.append(memory)
    return np.array(ways), memories, clearance


@pytest.mark.parametrize("cost", [True, False])
@pytest.mark.parametrize("mode", ["converged", "real_time"])
def test_distances_hold_between_the_samples(lwr4, cost, mode):
    """At full speed past an obstacle point, at every millisecond; samples alone would cut the corner."""
    problem = arm_problem(lwr4, obstacle_cost=cost, mode=mode, obstacle_timeout=10.0)
    q = lwr4.home + np.array([-0.9, 0, 0, 0, 0, 0, 0])
    goal = target(problem, lwr4.home + np.array([0.9, 0, 0, 0, 0, 0, 0]))
    on_the_way = problem.end_effector_pose(lwr4.home)[1] + np.array([0.02, 0.0, 0.02])
    ways, memories, clearance = closed_loop(problem, q, goal, at(on_the_way), 25)
    assert clearance >= 0.0
    assert clearance < 0.06  # it came near
    assert np.linalg.norm(problem.end_effector_pose(ways[-1])[1] - goal.p_WE[0]) < 0.05
    seen = [m.status for m in memories]
    assert NmpcStatus.BRAKING not in seen and NmpcStatus.START_INSIDE not in seen
    assert seen.count(NmpcStatus.SLACK) <= 1  # a plan at full speed, made before the way round was found


def test_a_moving_obstacle_is_kept_away_from(lwr4):
    """One that crosses the arm's place at 0.25 m/s: the arm yields and comes back, clear at every millisecond."""
    problem = arm_problem(lwr4, obstacle_timeout=10.0)
    hand = problem.end_effector_pose(lwr4.home)[1]
    obstacle = at(hand + np.array([0.1, -0.6, 0.05]), v=(0.0, 0.25, 0.0))
    ways, _, clearance = closed_loop(problem, lwr4.home, target(problem, lwr4.home), obstacle, 55)
    assert clearance >= 0.0
    assert np.abs(ways - lwr4.home).max() > 0.05
    assert np.linalg.norm(problem.end_effector_pose(ways[-1])[1] - hand) < 0.02


def test_a_command_that_would_come_too_near_is_not_applied(lwr4):
    """A plan that knows nothing of obstacles is not followed into one: the robot brakes as fast as it can instead."""
    problem = arm_problem(lwr4, obstacle_cost=False, obstacle_constraints=False, obstacle_timeout=10.0)
    q = lwr4.home + np.array([-0.9, 0, 0, 0, 0, 0, 0])
    goal = target(problem, lwr4.home + np.array([0.9, 0, 0, 0, 0, 0, 0]))
    obstacle = at(problem.end_effector_pose(lwr4.home)[1])
    ways, memories, _ = closed_loop(problem, q, goal, obstacle, 25)
    statuses = [memory.status for memory in memories]
    first = statuses.index(NmpcStatus.BRAKING)
    slower = brake(memories[first - 1].command, problem.a_max, problem.params.period)
    np.testing.assert_array_equal(memories[first].command, slower)
    for way, memory in zip(ways, memories):
        assert memory.status != NmpcStatus.SOLVED or smallest_clearance(problem, way, memory, obstacle, 0.0) >= 0.0


def test_without_the_margin_samples_alone_cut_corners(lwr4):
    """The margin is needed: the same fast pass without it and without the check comes nearer between samples."""
    clearances = []
    for between in (True, False):
        problem = arm_problem(lwr4, obstacle_cost=False, between_samples=between, obstacle_timeout=10.0)
        q = lwr4.home + np.array([-0.9, 0, 0, 0, 0, 0, 0])
        goal = target(problem, lwr4.home + np.array([0.9, 0, 0, 0, 0, 0, 0]))
        on_the_way = problem.end_effector_pose(lwr4.home)[1] + np.array([0.02, 0.0, 0.02])
        _, memories, clearance = closed_loop(problem, q, goal, at(on_the_way), 25)
        clearances.append((clearance, sum(m.status == NmpcStatus.BRAKING for m in memories)))
    assert clearances[0][0] >= 0.0 and clearances[0][1] == 0
    assert clearances[1][0] < 0.0 or clearances[1][1] > 0


@pytest.mark.parametrize(
    "fault, status",
    [
        ({"q": np.nan}, NmpcStatus.BAD_INPUT),
        ({"reference": NmpcReference(np.full((1, 3), np.nan), np.eye(3)[None])}, NmpcStatus.BAD_INPUT),
        ({"reference": NmpcReference(np.zeros((0, 3)), np.zeros((0, 3, 3)))}, NmpcStatus.BAD_INPUT),
        ({"obstacles": at([[np.nan, 0.0, 0.0]])}, NmpcStatus.BAD_INPUT),
        ({"obstacles": ObstaclePoints(np.zeros((2, 3)), np.zeros((1, 3)), np.zeros(2), 0.0)}, NmpcStatus.BAD_INPUT),
        ({"obstacles": at([[9.0, 0, 0]], status=ObstacleStatus.LOST)}, NmpcStatus.OBSTACLES_LOST),
        ({"age": 3.0}, NmpcStatus.OBSTACLES_LOST),
    ],
)
def test_bad_input_brakes_within_the_limits(lwr4, fault, status):
    """A status that names it, a command that is finite, in proportion, and at rest as soon as the limits allow."""
    problem = arm_problem(lwr4, acceleration_max=[2.0])
    goal = target(problem, lwr4.home + 0.5)
    _, memories, _ = closed_loop(problem, lwr4.home, goal, at([[9.0, 0.0, 0.0]]), 3, check=False)
    memory = memories[-1]
    assert np.abs(memory.command).max() > 0.3
    for _ in range(12):
        q = np.full(7, fault["q"]) if "q" in fault else memory.motion[1]
        inputs = {"reference": goal, "obstacles": at([[9.0, 0.0, 0.0]]), "age": 0.0} | fault
        after = nmpc_step(problem, memory, q, inputs["reference"], inputs["obstacles"], inputs["age"])
        assert after.status == status
        assert np.all(np.abs(after.command - memory.command) <= 2.0 * 0.1 + 1e-12)
        assert np.all(np.isfinite(after.motion))
        np.testing.assert_allclose(np.cross(after.command[:3], memory.command[:3]), 0.0, atol=1e-12)
        memory = after
    np.testing.assert_array_equal(memory.command, 0.0)


@pytest.mark.parametrize("mode", ["converged", "real_time"])
@pytest.mark.parametrize("solver", ["active_set", "daqp"])
def test_a_problem_without_solution_brakes(lwr4, solver, mode):
    """A solver that finds none is told, and what it leaves behind is never applied."""
    problem = arm_problem(lwr4, acceleration_max=[2.0], solver=solver, mode=mode)
    goal = target(problem, lwr4.home + 0.5)
    ways, memories, _ = closed_loop(problem, lwr4.home, goal, ObstaclePoints(), 3, check=False)
    problem.data = problem.data._replace(v_max=-problem.data.v_max)
    after = nmpc_step(problem, memories[-1], ways[-1], goal, ObstaclePoints(), 0.0)
    assert after.status == NmpcStatus.UNSOLVED
    slower = brake(memories[-1].command, problem.a_max, problem.params.period)
    assert np.abs(slower).max() > 0.1
    np.testing.assert_array_equal(after.command, slower)


def test_no_obstacles_are_no_fault(lwr4):
    """An empty port is a free cell."""
    problem = arm_problem(lwr4)
    memory = nmpc_step(
        problem, at_rest(problem, lwr4.home), lwr4.home, target(problem, lwr4.home), ObstaclePoints(), 0.0
    )
    assert memory.status == NmpcStatus.SOLVED and np.abs(memory.command).max() < 0.1


@pytest.mark.parametrize("retreat", [False, True])
def test_start_inside_an_obstacle(lwr4, retreat):
    """Braking by default; with `retreat` every step away from it, until it is clear."""
    problem = arm_problem(lwr4, retreat=retreat, obstacle_timeout=10.0)
    hand = problem.end_effector_pose(lwr4.home)[1]
    obstacle = at(hand + np.array([0.15, 0.0, 0.0]))
    ways, memories, _ = closed_loop(problem, lwr4.home, target(problem, lwr4.home), obstacle, 8, check=False)
    assert memories[0].status == NmpcStatus.START_INSIDE
    if not retreat:
        np.testing.assert_array_equal(ways[-1], lwr4.home)
        return
    distances = [np.linalg.norm(bench.test_points(problem, q) - obstacle.p_WO[0], axis=1).min() for q in ways]
    inside = np.array(distances) < 0.2 - 1e-6
    assert inside[0] and not inside[-1]
    assert np.all(np.diff(distances)[inside[:-1]] >= -1e-9)


def test_a_retreat_is_applied_where_it_leaves_more_room_than_braking(lwr4):
    """Something faster than the arm comes at the hand: it gives way, where braking lets it come nearer."""
    kept, statuses = [], ([], [])
    for retreat in (False, True):
        problem = arm_problem(lwr4, retreat=retreat, obstacle_timeout=10.0)
        q, memory, goal = lwr4.home, at_rest(problem, lwr4.home), target(problem, lwr4.home)
        hand, v = problem.end_effector_pose(q)[1], np.array([-1.0, 0.0, 0.0])
        for k in range(5):
            comes = ObstaclePoints((hand + [0.3 - 0.1 * k, 0.0, 0.0])[None], v[None], np.zeros(1), 0.0)
            memory = nmpc_step(problem, memory, q, goal, comes, 0.0)
            q = advance(problem.data, q, memory.command, 0.1)
            statuses[retreat].append(memory.status)
        gaps = np.linalg.norm(bench.test_points(problem, q) - (hand + [-0.2, 0.0, 0.0]), axis=1)
        kept.append(gaps.min())
    assert kept[0] < 0.15 and kept[1] > 0.2
    assert NmpcStatus.BRAKING in statuses[0] and NmpcStatus.RETREATING in statuses[1]


@pytest.mark.parametrize("late", [False, True])
def test_obstacles_grow_by_what_they_can_do_before_a_command_takes_effect(lwr4, late):
    """½ a t² with t from when they were seen until the first command that knows of them has been carried out."""
    problem = arm_problem(lwr4, obstacle_acceleration=4.0, delay_compensation=late)
    seen = ObstaclePoints(np.ones((1, 3)), np.zeros((1, 3)), np.full(1, 0.05), 0.0)
    scene = problem.scene(lwr4.home, target(problem, lwr4.home), seen, 0.05, int(late))
    assert scene.radius[0] == pytest.approx(0.05 + 2.0 * (0.25 if late else 0.15) ** 2)


def test_an_obstacle_that_jumps(lwr4):
    """1 m, onto the arm: braking; and back: the motion goes on."""
    problem = arm_problem(lwr4, obstacle_timeout=10.0)
    goal = target(problem, lwr4.home + 0.4)
    q, memory = lwr4.home, at_rest(problem, lwr4.home)
    seen = []
    for k in range(12):
        near = problem.end_effector_pose(q)[1] + np.array([0.0 if 3 <= k < 7 else 1.0, 0.0, 0.1])
        memory = nmpc_step(problem, memory, q, goal, at(near), 0.0)
        q = advance(problem.data, q, memory.command, 0.1)
        seen.append(memory.status)
    assert seen[4] == NmpcStatus.START_INSIDE and seen[-1] == NmpcStatus.SOLVED


def test_a_goal_behind_a_wall_is_not_reached_through_it(lwr4):
    """It stays in front, clear, and comes to rest."""
    problem = arm_problem(lwr4, obstacle_timeout=10.0)
    hand = problem.end_effector_pose(lwr4.home)[1]
    y, z = np.meshgrid(np.linspace(-0.8, 0.8, 17), np.linspace(-0.2, 1.6, 19))
    wall = np.column_stack([np.full(y.size, hand[0] + 0.3), y.ravel(), z.ravel()])
    goal = NmpcReference((hand + np.array([0.6, 0.0, 0.0]))[None], problem.end_effector_pose(lwr4.home)[0][None])
    ways, memories, _ = closed_loop(problem, lwr4.home, goal, at(wall), 15, check=False)
    for q in ways:
        assert (np.linalg.norm(bench.test_points(problem, q)[:, None] - wall, axis=2).min() - 0.2) >= 0.0
    assert np.abs(memories[-1].command).max() < 0.5


def test_an_unreachable_reference_is_approached(lwr4):
    """A target 3 m away: the arm stretches towards it and stays finite and within its limits."""
    problem = arm_problem(lwr4)
    goal = NmpcReference(np.array([[3.0, 0.0, 1.0]]), np.eye(3)[None])
    ways, _, _ = closed_loop(problem, lwr4.home, goal, ObstaclePoints(), 20, check=False)
    first, last = (np.linalg.norm(problem.end_effector_pose(q)[1] - goal.p_WE[0]) for q in (ways[0], ways[-1]))
    assert last < first - 0.1


def test_a_horizon_of_one_works(lwr4):
    problem = arm_problem(lwr4, horizon=1)
    goal = target(problem, lwr4.home + 0.05)
    ways, _, _ = closed_loop(problem, lwr4.home, goal, at([[9.0, 0, 0]]), 20, check=False)
    assert np.linalg.norm(problem.end_effector_pose(ways[-1])[1] - goal.p_WE[0]) < 0.01


def test_braking_keeps_direction_and_limits():
    u, a = np.array([1.0, -0.5, 0.0]), np.array([2.0, 5.0, 1.0])
    np.testing.assert_allclose(brake(u, a, 0.1), 0.8 * u)
    np.testing.assert_array_equal(brake(0.1 * u, a, 0.1), 0.0 * u)
    np.testing.assert_array_equal(brake(0.0 * u, a, 0.1), 0.0 * u)


def test_a_platform_with_wheels_never_slips():
    """Driving a curve: the chord of each stage is an arc's, and the command has no sideways part at any instant."""
    problem = bench.benchmark_problem("1", nonholonomic=["px", "py", "pz"])
    q, R = bench.start(problem)
    p = problem.end_effector_pose(q)[1]
    t = 0.1 * np.arange(60)
    path = np.column_stack([0.4 * (1.0 - np.cos(0.25 * t)), p[1] + 0.15 * t, np.full(60, p[2])])
    memory, errors = at_rest(problem, q), []
    for k in range(30):
        reference = NmpcReference(path[k:], np.broadcast_to(R, (60 - k, 3, 3)).copy())
        memory = nmpc_step(problem, memory, q, reference, ObstaclePoints(), 0.0)
        assert memory.status in (NmpcStatus.SOLVED, NmpcStatus.UNCONVERGED)
        for s in np.linspace(0.0, 0.1, 11):
            there = advance(problem.data, q, memory.command, s)
            v = joint_velocity(problem.data, there, memory.command)
            assert abs(-v[0] * np.sin(there[2]) + v[1] * np.cos(there[2])) < 1e-12
            h = 1e-6
            around = [advance(problem.data, q, memory.command, s + d) for d in (-h, h)]
            np.testing.assert_allclose((around[1] - around[0]) / (2 * h), v, atol=1e-6)
        q = advance(problem.data, q, memory.command, 0.1)
        np.testing.assert_allclose(q, memory.motion[1], atol=1e-6)
        errors.append(np.linalg.norm(problem.end_effector_pose(q)[1] - path[k + 1]))
    assert abs(q[2] - np.pi / 2) > 0.01
    assert max(errors) < 0.05
    u = command_to(problem.data, q, advance(problem.data, q, memory.command, 0.1), 0.1)
    np.testing.assert_allclose(u, memory.command, atol=1e-12)


def controller(lwr4, **changes):
    return NmpcController(lwr4, "link_7", POINTS, NmpcParameters(**({"period": benches.PERIOD} | changes)))


def test_ports_and_context_clone(lwr4):
    """Names and sizes; a clone goes on as the original does; at rest before the first step."""
    system = controller(lwr4)
    hand = system.problem.end_effector_pose(lwr4.home)[1]
    inputs = {
        "position_measured": lwr4.home,
        "reference": target(system.problem, lwr4.home + 0.1),
        "obstacles": at(hand + np.array([0.3, 0.0, 0.0])),
    }
    rest = system.CreateDefaultContext()
    np.testing.assert_array_equal(system.GetOutputPort("velocity_commanded").Eval(rest), 0.0)
    assert system.GetOutputPort("status").Eval(rest)[0] == NmpcStatus.WAITING
    one = benches.Bench(system, **inputs)
    one.run(2)
    two = one.clone()
    for b in (one, two):
        b.run(3, position_measured=lwr4.home + 0.01)
    for name in ("velocity_commanded", "predicted_motion", "status", "slack", "min_clearance"):
        np.testing.assert_array_equal(one.read(name), two.read(name))
    assert one.read("predicted_motion").shape == (11 * 7,)
    assert one.read("status") == NmpcStatus.SOLVED
    np.testing.assert_allclose(one.read("predicted_motion")[:7], lwr4.home + 0.01)
    assert not system.HasAnyDirectFeedthrough()


def test_without_reference_or_obstacles_it_holds_the_home_pose(lwr4):
    b = benches.Bench(controller(lwr4), position_measured=lwr4.home)
    b.run(3)
    assert np.abs(b.read("velocity_commanded")).max() < 0.05
    assert b.read("min_clearance") == np.inf


def test_delay_compensation_applies_what_was_computed_for_that_time(lwr4):
    """The command of a period is the one computed in the period before; the plan starts where it leads."""
    problem = arm_problem(lwr4, delay_compensation=True)
    goal = target(problem, lwr4.home + 0.3)
    q, memory, before = lwr4.home, at_rest(problem, lwr4.home), None
    for _ in range(25):
        memory = nmpc_step(problem, memory, q, goal, ObstaclePoints(), 0.0)
        if before is not None:
            np.testing.assert_array_equal(memory.command, before)
        before = memory.pending
        np.testing.assert_allclose(memory.motion[1], advance(problem.data, q, memory.command, 0.1), atol=1e-12)
        q = advance(problem.data, q, memory.command, 0.1)
    assert np.linalg.norm(problem.end_effector_pose(q)[1] - goal.p_WE[0]) < 0.01
