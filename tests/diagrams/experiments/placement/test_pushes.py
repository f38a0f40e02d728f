"""What is placed around an arm by its geometry: pushes, obstacles, skin and gains; and what an arm cannot do."""

import numpy as np
import pytest
from arms import EXAMPLES, arm_path
from experiments.evidence.arm_trials import arms_table
from experiments.nmpc.jobs import point_positions
from experiments.nmpc.manipulator import manipulator_job
from experiments.placement.arm import null_space_gains, placed_arm
from experiments.placement.check import main
from experiments.placement.guiding import skin_patch
from experiments.placement.null_space import elbow_touch, self_motion
from experiments.placement.predictive import place_job
from experiments.placement.pushes import AXES, YIELD, push_on, side_camera, yielded
from nmpc_manipulator import scenario_for

from saphari_drake.errors import ModelError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.skin.layout import SkinLayout, SkinLayoutParameters
from saphari_drake.robots.arm_file import load_arm
from saphari_drake.robots.catalog import models_dir
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.pushing_hand import find_target
from saphari_drake.simulation.world.hand import HandParameters

UR5 = EXAMPLES / "ur_description" / "urdf" / "ur5_robot.urdf"
PATHS = {"panda": arm_path("panda", None), "ur5": UR5}


@pytest.fixture(scope="module", params=PATHS)
def arm(request):
    return placed_arm(load_arm(str(PATHS[request.param])))


def test_push_meets_its_link_where_torques_show_it(arm):
    camera = CameraParameters()
    side_camera(arm, camera)
    link = arm.chain.links(arm.robot, arm.chain.forearm)[0]
    push = push_on(arm, camera, HandParameters(), link, AXES)
    target = find_target(arm.robot, arm.robot.home, push)
    assert -target.n_W @ push.direction > 0.9
    J = arm.terms.point(link, arm.terms.in_link(link, target.p_WT)).Jv_WC
    assert np.linalg.svd(J, compute_uv=False)[2] > 0.05
    assert np.all(np.abs(J.T @ target.direction * push.force) + np.abs(arm.terms.g) <= 0.81 * arm.robot.tau_max)


def test_no_other_link_comes_to_the_hand_when_the_arm_yields(arm):
    """Each link is moved by the push as M⁻¹Jᵀ of the contact says; fist and forearm stay clear of all of them."""
    camera, hand = CameraParameters(), HandParameters()
    side_camera(arm, camera)
    for link in arm.chain.links(arm.robot, arm.chain.forearm):
        push = push_on(arm, camera, hand, link, AXES)
        target = find_target(arm.robot, arm.robot.home, push)
        moved = yielded(arm, link, target.p_WT, target.direction)
        p_WT = moved.terms.position(link, arm.terms.in_link(link, target.p_WT))
        np.testing.assert_allclose(p_WT - target.p_WT, YIELD * target.direction, atol=0.02)
        finger = np.array(push.finger or push.direction)
        shapes = arm.robot.shapes
        R_WS, p_WS = shapes.in_world(moved.terms.R_WL, moved.terms.p_WL)
        for back in np.linspace(hand.finger_length, hand.finger_length + hand.forearm_length, 6):
            everything = np.ones(shapes.count, dtype=bool)
            gap = nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, everything, p_WT - back * finger)[1]
            assert gap > hand.forearm_radius


def test_gains_of_the_null_space_follow_inertia_and_torque(arm):
    stiffness, damping = map(np.array, null_space_gains(arm))
    inertia = np.diag(arm.terms.M)
    assert stiffness.shape == damping.shape == (arm.robot.n,) and np.all(stiffness <= 9.0 * inertia + 1e-12)
    assert np.all(0.5 * stiffness <= 0.5 * arm.robot.tau_max + 1e-12)
    np.testing.assert_allclose(damping / (2.0 * np.sqrt(stiffness * inertia)), 1.2)


def test_self_motion_keeps_the_tip_and_moves_the_elbow(arm):
    N, h = self_motion(arm), 1e-6
    touch = elbow_touch(arm)
    for v in N.T:
        tips = [arm.robot.kinematics(arm.robot.home + s * h * v).p_WL[-1] for s in (-1.0, 1.0)]
        assert np.linalg.norm(tips[1] - tips[0]) < 1e-9
    J = arm.terms.point(touch.link, touch.aim).Jv_WC @ N
    assert np.linalg.norm(J, 2) == pytest.approx(touch.mobility) and touch.direction[2] == 0.0


def test_obstacles_are_in_the_way_and_not_in_the_arm(arm):
    scenario = scenario_for("both")
    place_job(scenario, arm.robot)
    job = manipulator_job(arm.robot, scenario.job)
    d_min = scenario.job.d_min

    def least(q):
        p = point_positions(arm.robot, job.points, evaluate_dynamics(arm.robot, q, np.zeros(arm.robot.n)))
        return min(np.linalg.norm(p - o, axis=1).min() for o in scenario.job.obstacles)

    start, goal = arm.robot.home, np.deg2rad(scenario.job.goal_deg)
    assert least(start) > d_min
    assert min(least(start + s * (goal - start)) for s in np.linspace(0.0, 1.0, 21)) < d_min


def test_skin_lies_on_the_arm(arm):
    layout = SkinLayoutParameters()
    skin_patch(arm, layout)
    assert SkinLayout(arm.robot, layout).link in (arm.chain.upper_arm, arm.chain.forearm)


def test_arm_without_room_for_skin_says_so(arm):
    with pytest.raises(ModelError, match="no round shape"):
        skin_patch(arm, SkinLayoutParameters(rows=60))


@pytest.mark.parametrize("name, status, line", [
    ("planar_6r", 2, "no home posture"), ("missing", 2, "no model file"), ("lwr4", 0, "identify: arm, tool: can run"),
])  # fmt: skip
def test_check_robot_tells_what_works(name, status, line, capsys):
    path = models_dir() / name / f"{name}.urdf"
    assert main([str(path), "--only", "identify"], models_dir().parent / "diagrams") == status
    shown = capsys.readouterr()
    assert line in (shown.out if status < 2 else shown.err)
    assert status < 2 or len(shown.err.strip().splitlines()) == 1


def test_table_of_arms_gives_each_reason_once():
    cannot = {"made": False, "cannot": "a: no null space", "options": []}
    missed = {
        "made": True,
        "passed": False,
        "missed": {"x_m": {"value": 0.01234, "bound": [None, 0.01]}},
        "options": [],
    }
    text = arms_table({
        "a": {"null_space_ball/momentum": cannot, "null_space_wall/momentum": cannot, "identify/arm": missed},
        "b": {"identify/arm": {"made": True, "passed": True, "missed": {}, "options": []}},
    })  # fmt: skip
    assert text.count("no (1)") == 2 and text.count("1. a: no null space") == 1
    assert "misses `x_m` 0.0123" in text and "| met |" in text
