"""A stack on its robot: Jacobians and rates by finite differences, sizes, and inputs that are not finite."""

import re

import numpy as np
import pytest
from arms import states
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.control.reverse_priority import stack as module
from saphari_drake.control.reverse_priority import tasks
from saphari_drake.control.reverse_priority.law import PriorityStatus
from saphari_drake.control.reverse_priority.stack import PriorityStack, evaluate_component
from saphari_drake.control.reverse_priority.system import frame_reference
from saphari_drake.errors import ModelError, StateError
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

TARGETS = np.array([[0.4, -0.3, 0.7, 0.2, -0.1, 0.3], [-0.2, 0.5, 0.9, 0.0, 0.4, -0.2]])
STEP = 1e-6


def components(robot):
    end, middle = robot.link_names[-1], robot.link_names[2]
    return [
        tasks.joint_coordinate(robot, robot.joint_names[1]),
        tasks.plane_distance(robot, end, [1.0, 2.0, -0.5], 0.3, [0.1, 0.0, 0.2]),
        tasks.target_distance(robot, middle, 1, 0.1, [0.0, 0.05, 0.1]),
        tasks.target_distance(robot, end, 0),
        tasks.view_cosine(robot, end, 0, [0.2, 0.1, 1.0]),
        tasks.view_cosine(robot, middle, 1),
    ]


@pytest.mark.parametrize("arm", ["lwr4", "panda", "mobile"])
def test_jacobians_and_rates_are_derivatives(load_arm, arm):
    """dx_C/dt along q̇ and along the motion of the targets, by central differences, on arms of all kinds."""
    robot = load_arm(arm)
    for component in components(robot):
        for q, v in states(robot, 5):
            _, J, own = evaluate_component(robot, component, q, TARGETS)
            moved = TARGETS.copy()
            moved[:, :3] += STEP * TARGETS[:, 3:]
            back = TARGETS.copy()
            back[:, :3] -= STEP * TARGETS[:, 3:]
            after = evaluate_component(robot, component, q + STEP * v, moved)[0]
            before = evaluate_component(robot, component, q - STEP * v, back)[0]
            np.testing.assert_allclose(J @ v + own, (after - before) / (2 * STEP), atol=2e-8, err_msg=component.name)


def test_task_rows_are_derivatives_of_their_error(lwr4):
    """For a constant reference d(error)/dt = −J q̇, orientation near the reference included."""
    stack = PriorityStack(lwr4, [tasks.pose_task(lwr4, "link_7"), tasks.position_task(lwr4, "link_5", "xz")])
    for q, v in states(lwr4, 5, seed=3):
        rotation, position = forward(lwr4, "link_7", q)
        references = np.zeros((2, 18))
        references[0] = frame_reference(RigidTransform(RotationMatrix(rotation), position + 0.1))
        errors = [stack.solve(q + s * STEP * v, 0.0 * v, references, TARGETS, 0.01).error for s in (-1.0, 0.0, 1.0)]
        J = stack.solve(q, 0.0 * v, references, TARGETS, 0.01).J_tasks
        np.testing.assert_allclose((errors[2] - errors[0]) / (2 * STEP), -J @ v, atol=1e-7)
        np.testing.assert_allclose(errors[1][:3], 0.0, atol=1e-12)


def forward(robot, frame, q):
    link, X_LF = robot.frame(frame)
    terms = evaluate_dynamics(robot, q, np.zeros(robot.n))
    return terms.R_WL[link], terms.p_WL[link] + terms.R_WL[link] @ X_LF.translation()


def test_a_field_of_view_keeps_its_target_in_the_image(lwr4):
    """A camera on the flange: a lower bound of the cosine holds on top of a task that turns it away."""
    camera = tasks.view_cosine(lwr4, "link_7", 0)
    turn_away = tasks.ScalarTask(tasks.joint_coordinate(lwr4, "joint_6"), gain=1.0)
    rotation_7, p_7 = forward(lwr4, "link_7", lwr4.home)
    target = np.array([[*(p_7 + rotation_7 @ [0.05, 0.0, 0.5]), 0.0, 0.0, 0.0]])
    view = tasks.Bound(camera, lower=np.cos(np.deg2rad(30.0)), buffer=0.05)
    cosines = {}
    for name, levels in {"with": [[view], turn_away], "without": [turn_away]}.items():
        stack, q, v = PriorityStack(lwr4, levels), lwr4.home.copy(), np.zeros(7)
        reference = np.array([[q[5] - 1.5, *np.zeros(17)]])
        cosines[name] = []
        for _ in range(800):
            v = stack.solve(q, 0.95 * v, reference, target, 0.005).v
            q = q + 0.005 * v
            cosines[name].append(evaluate_component(lwr4, camera, q, target)[0])
    assert min(cosines["with"]) >= np.cos(np.deg2rad(30.0)) > min(cosines["without"])


def test_sizes_that_do_not_fit_are_refused(lwr4):
    """And too few targets."""
    bound = tasks.Bound(tasks.target_distance(lwr4, "link_7", 1), lower=0.1)
    stack = PriorityStack(lwr4, [[bound], tasks.position_task(lwr4, "link_7")])
    good = [lwr4.home, np.zeros(7), np.zeros((1, 18)), TARGETS]
    for place, value in [(0, np.zeros(6)), (1, np.zeros(8)), (2, np.zeros((2, 18))), (3, TARGETS[:1])]:
        with pytest.raises(StateError, match="sizes"):
            stack.solve(*good[:place], value, *good[place + 1 :], 0.005)


@pytest.mark.parametrize("place", range(4), ids=["position", "velocity", "reference", "target"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308])
def test_without_a_finite_input_there_is_no_motion(lwr4, place, value):
    """One entry is enough; the next pass with finite ones is as ever."""
    bound = tasks.Bound(tasks.target_distance(lwr4, "link_7", 1), lower=0.1)
    stack = PriorityStack(lwr4, [[bound], tasks.pose_task(lwr4, "link_7"), tasks.joint_limits(lwr4)])
    good = [lwr4.home, np.zeros(7), np.array([[*np.eye(3).ravel(), *np.zeros(9)]]), TARGETS]
    before = stack.solve(*good, 0.005)
    bad = [array.copy() for array in good]
    bad[place].flat[-1] = value
    result = stack.solve(*bad, 0.005)
    if result.status == PriorityStatus.INVALID or not abs(value) < np.inf:
        assert result.status == PriorityStatus.INVALID and result.scale == 0.0
        np.testing.assert_array_equal(result.v, np.zeros(7))
        np.testing.assert_array_equal(result.activation, np.zeros(15))
    assert np.isfinite(result.v).all() and np.all(np.abs(result.v) <= lwr4.v_max * (1 + 1e-9))
    after = stack.solve(*good, 0.005)
    assert after.status != PriorityStatus.INVALID
    np.testing.assert_array_equal(after.v, before.v)


@given(seed=st.integers(0, 10_000))
def test_bounds_that_contradict_one_another_are_told(lwr4, seed):
    """Two walls with the arm behind both: status INFEASIBLE, a finite command within its limits; one wall alone: OK."""
    rng = np.random.default_rng(seed)
    q, task = lwr4.home + rng.uniform(-0.2, 0.2, 7), tasks.position_task(lwr4, "link_7")
    height = tasks.plane_distance(lwr4, "link_7", rng.normal(size=3))
    x, gap = evaluate_component(lwr4, height, q, TARGETS)[0], rng.uniform(0.02, 0.1)
    above, below = tasks.Bound(height, lower=x + gap), tasks.Bound(height, upper=x - gap)
    found = {}
    for name, bounds in {"both": [above, below], "above": [above], "below": [below], "soft": []}.items():
        levels = [bounds, task, [above, below]]
        stack = PriorityStack(lwr4, levels)
        result = stack.solve(q, np.zeros(7), np.zeros((1, 18)), TARGETS, 0.005)
        found[name] = result.status
        assert np.isfinite(result.v).all() and np.all(np.abs(result.v) <= lwr4.v_max * (1 + 1e-9))
    assert found.pop("both") == PriorityStatus.INFEASIBLE
    assert PriorityStatus.INFEASIBLE not in found.values()


def test_a_reference_out_of_all_bounds_moves_nothing(lwr4):
    """All inputs are finite, the velocity that the gain asks for is not: the task is scaled to nothing."""
    stack, far = PriorityStack(lwr4, [tasks.position_task(lwr4, "link_7")]), np.zeros((1, 18))
    far[0, 9] = 1e308
    result = stack.solve(lwr4.home, np.zeros(7), far, TARGETS, 0.005)
    assert result.status == PriorityStatus.SCALED and result.scale == 0.0
    np.testing.assert_array_equal(result.v, np.zeros(7))


def test_a_law_without_a_solution_is_no_motion(lwr4, monkeypatch):
    """Multipliers that are not found are NaN: the command is zero all the same, and told."""
    stack = PriorityStack(lwr4, [tasks.joint_limits(lwr4)])
    lost = np.full(7, np.nan), np.ones(14), 1.0, PriorityStatus.OK.value
    monkeypatch.setattr(module, "solve_stack", lambda *_: lost)
    monkeypatch.setattr(module, "_solve", module._solve.py_func)
    result = stack.solve(lwr4.home, np.zeros(7), np.zeros((0, 18)), TARGETS, 0.005)
    assert result.status == PriorityStatus.INVALID and result.scale == 0.0
    np.testing.assert_array_equal(np.concatenate([result.v, result.activation]), np.zeros(21))


def test_velocity_limits_are_needed(tmp_path, lwr4):
    """A model without them is named."""
    text = re.sub(r' velocity="[0-9.]+"', "", lwr4.path.read_text())
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    with pytest.raises(ModelError, match=r"arm\.urdf.*velocity limit"):
        PriorityStack(RobotModel(path), [[]])
