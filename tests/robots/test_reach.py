"""How far a point can be brought from the shoulder."""

import numpy as np
import pytest
from arms import arm_path, states, write_mobile_arm

from saphari_drake.robots.arm_file import load_arm
from saphari_drake.robots.model import RobotModel
from saphari_drake.robots.reach import reach


def test_reach_is_the_length_of_the_stretched_arm(lwr4):
    """The LWR4's links are 0.4 + 0.39 + 0.078 m from the shoulder to the flange."""
    shoulder, farthest = reach(lwr4, 6, np.array([0.0, 0.0, 0.1]))
    np.testing.assert_allclose(shoulder, [0.0, 0.0, 0.3105], atol=1e-9)
    assert farthest == pytest.approx(0.968, abs=1e-6)


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_nothing_is_farther(name):
    robot, p_LC = load_arm(str(arm_path(name, None))), np.array([0.02, 0.0, 0.1])
    shoulder, farthest = reach(robot, robot.n - 1, p_LC)
    away = [
        np.linalg.norm(robot.kinematics(np.clip(q, robot.q_min, robot.q_max)).position(robot.n - 1, p_LC) - shoulder)
        for q, _ in states(robot, 500)
    ]
    assert 0.8 * farthest < max(away) <= farthest + 1e-9


def test_a_mobile_base_has_no_shoulder_that_rests(tmp_path):
    robot = RobotModel(write_mobile_arm(tmp_path))
    assert reach(robot, robot.n - 1, np.zeros(3))[1] == 0.0
