"""Components, tasks and bounds: Jacobians and rates by finite differences, limits, sizes and errors."""

import re

import numpy as np
import pytest
from arms import states
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.control.reverse_priority import tasks
from saphari_drake.control.reverse_priority.components import rotation_error
from saphari_drake.control.reverse_priority.stack import PriorityStack, evaluate_component
from saphari_drake.control.reverse_priority.system import frame_reference
from saphari_drake.errors import ModelError, ParameterError, StateError, UnknownNameError
from saphari_drake.math.rotations import axis_rotation
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


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-7, np.pi])
def test_rotation_error_is_the_turn_that_is_missing(angle):
    """Up to half a turn, about an axis that is none of the coordinate axes; at half a turn either sign will do."""
    axis = np.array([0.6, -0.48, 0.64])
    R = RotationMatrix.MakeZRotation(0.4).matrix()
    target = axis_rotation(axis, angle) @ R
    error = rotation_error(R, target)
    sign = np.sign(error @ axis) if angle > 3.14 else 1.0
    np.testing.assert_allclose(error, sign * angle * axis, atol=1e-6)


def test_joint_limits_are_the_models(lwr4):
    """Both sides of every joint, moved inwards by the margin."""
    stack = PriorityStack(lwr4, [tasks.joint_limits(lwr4, margin=0.1)])
    assert len(stack.sides) == 14
    np.testing.assert_allclose(np.sort(stack.bounds), np.sort(np.concatenate([lwr4.q_max - 0.1, -lwr4.q_min - 0.1])))


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


def test_bad_input_is_told(lwr4, tmp_path):
    """Names that do not exist, empty and crossed ranges, axes and directions that mean nothing."""
    q1 = tasks.joint_coordinate(lwr4, "joint_1")
    for call, error, words in [
        (lambda: tasks.joint_coordinate(lwr4, "joint_9"), UnknownNameError, "joint_1"),
        (lambda: tasks.position_task(lwr4, "hand"), UnknownNameError, "link_7"),
        (lambda: tasks.plane_distance(lwr4, "link_7", [0, 0, 0]), ParameterError, "normal"),
        (lambda: tasks.target_distance(lwr4, "link_7", -1), ParameterError, "target"),
        (lambda: tasks.Bound(q1), ParameterError, "finite"),
        (lambda: tasks.Bound(q1, 1.0, 0.0), ParameterError, "above"),
        (lambda: tasks.Bound(q1, 0.0, buffer=0.0), ParameterError, "buffer"),
        (lambda: tasks.FrameTask("x", 0, (0, 0, 0), tuple(np.eye(3).ravel()), (3, 3)), ParameterError, "axes"),
        (lambda: tasks.ScalarTask(q1, gain=-1.0), ParameterError, "gain"),
        (lambda: PriorityStack(lwr4, []), ParameterError, "levels"),
        (lambda: PriorityStack(lwr4, [[]], damping=0.0), ParameterError, "damping"),
    ]:
        with pytest.raises(error, match=words):
            call()


def test_states_that_cannot_be_used_are_refused(lwr4):
    """Wrong sizes, too few targets, NaN."""
    bound = tasks.Bound(tasks.target_distance(lwr4, "link_7", 1), lower=0.1)
    stack = PriorityStack(lwr4, [[bound], tasks.position_task(lwr4, "link_7")])
    good = [lwr4.home, np.zeros(7), np.zeros((1, 18)), TARGETS]
    for place, value in [(0, np.zeros(6)), (1, np.zeros(8)), (2, np.zeros((2, 18))), (3, TARGETS[:1])]:
        with pytest.raises(StateError, match="sizes"):
            stack.solve(*good[:place], value, *good[place + 1 :], 0.005)
    for place in range(4):
        with pytest.raises(StateError, match="finite"):
            stack.solve(*good[:place], np.full(good[place].shape, np.nan), *good[place + 1 :], 0.005)


def test_velocity_limits_are_needed(tmp_path, lwr4):
    """A model without them is named."""
    text = re.sub(r' velocity="[0-9.]+"', "", lwr4.path.read_text())
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    with pytest.raises(ModelError, match=r"arm\.urdf.*velocity limit"):
        PriorityStack(RobotModel(path), [[]])
