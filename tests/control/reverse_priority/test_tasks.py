"""Tasks and bounds: the limits of a robot, and input that means nothing."""

import numpy as np
import pytest

from saphari_drake.control.reverse_priority import tasks
from saphari_drake.control.reverse_priority.stack import PriorityStack
from saphari_drake.errors import ParameterError, UnknownNameError


def test_joint_limits_are_the_models(lwr4):
    """Both sides of every joint, moved inwards by the margin."""
    stack = PriorityStack(lwr4, [tasks.joint_limits(lwr4, margin=0.1)])
    assert len(stack.sides) == 14
    np.testing.assert_allclose(np.sort(stack.bounds), np.sort(np.concatenate([lwr4.q_max - 0.1, -lwr4.q_min - 0.1])))


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
        (lambda: PriorityStack(lwr4, [[]]), ParameterError, "levels"),
        (lambda: PriorityStack(lwr4, [[]], damping=0.0), ParameterError, "damping"),
    ]:
        with pytest.raises(error, match=words):
            call()
