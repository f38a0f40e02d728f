"""The parts of an arm by geometry, and the home posture that is found for it."""

import numpy as np
import pytest
from arms import EXAMPLES, arm_path, write_mobile_arm

from saphari_drake.errors import ModelError
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.robots.arm_file import load_arm
from saphari_drake.robots.chain import arm_chain, middle_range
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.robots.posture import bent_home, clear_of_itself, is_home

UR5 = EXAMPLES / "ur_description" / "urdf" / "ur5_robot.urdf"


@pytest.fixture(scope="module", params=["panda", "ur5"])
def robot(request):
    return load_arm(str(UR5 if request.param == "ur5" else arm_path("panda", None)))


@pytest.mark.parametrize("name, elbow", [("lwr4", "joint_4"), ("panda", "panda_joint4"), ("xarm7", "joint4")])
def test_elbow_is_the_joint_that_folds_the_arm(name, elbow):
    robot = load_arm("lwr4" if name == "lwr4" else str(arm_path(name, None)))
    assert robot.joint_names[arm_chain(robot).elbow] == elbow


def test_six_joints_have_an_elbow_too():
    robot = load_arm(str(UR5))
    assert robot.joint_names[arm_chain(robot).elbow] == "elbow_joint"


def test_home_keeps_what_is_asked_of_it(robot):
    home, chain = bent_home(robot), arm_chain(robot)
    low, high = middle_range(robot)
    assert np.all(home >= low - 1e-9) and np.all(home <= high + 1e-9)
    terms = evaluate_dynamics(robot, home, np.zeros(robot.n))
    assert np.all(np.abs(terms.g) <= 0.6 * robot.tau_max)
    assert terms.p_WL[chain.elbow :, 2].min() >= 0.12 and clear_of_itself(robot, home)
    J = np.vstack([terms.point(chain.tip, np.zeros(3)).Jv_WC / chain.reach, terms.S[:, :3].T])
    assert np.linalg.svd(J, compute_uv=False)[5] > 0.1
    np.testing.assert_array_equal(bent_home(robot), home)


def test_zeros_are_no_home(robot):
    assert not is_home(robot)
    assert is_home(robot.with_home(0.5 * (robot.q_min + robot.q_max) + 0.01))


def test_what_is_no_arm_is_told_in_one_line(tmp_path):
    robot = RobotModel(write_mobile_arm(tmp_path))
    assert np.any(robot.tree.kind != REVOLUTE)
    with pytest.raises(ModelError, match="has 5 joints"):
        arm_chain(robot)
