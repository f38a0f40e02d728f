"""Models of all sorts come into a plant as they are, or one line says what is wrong."""

import numpy as np
import pytest
from arms import joint, link, states, write_urdf
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from saphari_drake.errors import ModelError, StateError, UnknownNameError
from saphari_drake.robots.assembly import add_packages
from saphari_drake.robots.catalog import models_dir
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

LWR4 = models_dir() / "lwr4" / "lwr4.urdf"
ARM = (link("base", 0), link("a"), link("b"), joint("j1", "base", "a"), joint("j2", "a", "b"))
HAND = (
    link("left"),
    link("right"),
    joint("grip", "b", "left", "prismatic"),
    joint("follow", "b", "right", "prismatic"),
)
FOLLOW = '<mimic joint="grip" multiplier="-2" offset="0.1"/></joint>'
INERTIAL = "<inertial><mass>1</mass><inertia><ixx>.03</ixx><iyy>.03</iyy><izz>.03</izz></inertia></inertial>"


def sdf_joint(name, parent, child):
    axis = "<axis><xyz>0 1 0</xyz><limit><lower>-1</lower><upper>1</upper><effort>7</effort></limit></axis>"
    return f'<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>{axis}</joint>'


def write_sdf(folder, *joints):
    links = "".join(f'<link name="{name}">{INERTIAL}</link>' for name in "abc")
    path = folder / "arm.sdf"
    path.write_text(f'<sdf version="1.9"><model name="m"><link name="base"/>{links}{"".join(joints)}</model></sdf>')
    return path


@pytest.fixture
def hand(tmp_path):
    follower = HAND[3].replace("</joint>", FOLLOW)
    return write_urdf(tmp_path, *ARM, *HAND[:3], follower)


# ---- joints that do not move ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.0, 0.001])
def test_a_gripper_that_mimics_stays_where_it_is_told(hand, step):
    """The follower stays where its leader asks for; model and plant agree, and no constraint is left."""
    robot = RobotModel(hand, home={"j2": 0.5, "grip": 0.3})
    assert robot.joint_names == ("j1", "j2") and robot.home.tolist() == [0.0, 0.5]
    plant = MultibodyPlant(step)
    robot.add_to(plant)
    plant.Finalize()
    assert plant.num_positions() == plant.num_actuators() == 2 and plant.num_constraints() == 0
    context = plant.CreateDefaultContext()
    for q, v in states(robot, 3):
        plant.SetPositions(context, q)
        np.testing.assert_allclose(evaluate_dynamics(robot, q, v).M, plant.CalcMassMatrix(context), atol=1e-12)
        for body in ("left", "right"):
            _, X_LF = robot.frame(body)
            at = robot.kinematics(q)
            expected = plant.GetBodyByName(body).EvalPoseInWorld(context).translation()
            np.testing.assert_allclose(at.position(1, X_LF.translation()), expected, atol=1e-12)
    opened = RobotModel(hand).frame("right")[1].translation() - robot.frame("right")[1].translation()
    assert np.linalg.norm(opened) == pytest.approx(2.0 * 0.3)


def test_a_choice_of_joints(hand, tmp_path):
    """Named, or by a pattern; what follows another, or is followed, cannot be chosen."""
    assert RobotModel(hand, joints=["j2"]).joint_names == ("j2",)
    assert RobotModel(hand, joints=["j*"]).joint_names == ("j1", "j2")
    for name, told in (("follow", "follows 'grip'"), ("grip", "is followed by 'follow'")):
        with pytest.raises(ModelError, match=told):
            RobotModel(hand, joints=["j1", name])
    with pytest.raises(UnknownNameError, match="no joint 'elbow'; there are: j1, j2, grip, follow"):
        RobotModel(hand, joints=["elbow"])
    with pytest.raises(UnknownNameError, match="no joint 'elbow'"):
        RobotModel(hand, home={"elbow": 0.0})


# ---- home ----------------------------------------------------------------------------------------------------------


def test_home_is_inside_the_limits(tmp_path):
    """The file's zero outside them becomes their middle; one that is given is refused."""
    bent = joint("j2", "a", "b").replace('lower="-2" upper="2"', 'lower="-3" upper="-1"')
    path = write_urdf(tmp_path, *ARM[:4], bent)
    robot = RobotModel(path)
    np.testing.assert_array_equal(robot.home, [0.0, -2.0])
    for bad in (lambda: RobotModel(path, home=[0.0, 0.0]), lambda: robot.with_home([2.5, -2.0])):
        with pytest.raises(StateError, match=r"home: .* of j\d is outside its limits"):
            bad()


# ---- several, loops, limits ----------------------------------------------------------------------------------------


def test_two_arms_in_one_plant():
    """Each keeps its own dynamics; the second one gets another name."""
    left, right = RobotModel(LWR4), RobotModel(LWR4)
    plant = MultibodyPlant(0.0)
    instances = [robot.add_to(plant) for robot in (left, right)]
    plant.Finalize()
    assert len({plant.GetModelInstanceName(instance) for instance in instances}) == 2
    context, q = plant.CreateDefaultContext(), np.linspace(-1.0, 1.0, 14)
    plant.SetPositions(context, q)
    M = plant.CalcMassMatrix(context)
    for k, robot in enumerate((left, right)):
        own = slice(7 * k, 7 * k + 7)
        np.testing.assert_allclose(evaluate_dynamics(robot, q[own], np.zeros(7)).M, M[own, own], atol=1e-12)
        assert plant.num_actuators(instances[k]) == 7
    np.testing.assert_array_equal(M[:7, 7:], np.zeros((7, 7)))


def test_loops_are_refused_in_one_line(tmp_path):
    links = link("base", 0), link("a"), link("b"), link("c")
    closed = joint("j1", "base", "a"), joint("j2", "a", "b"), joint("j3", "base", "c"), joint("j4", "c", "b")
    mujoco = '<mujoco model="m"><worldbody>{a}{b}</worldbody><equality><connect body1="a" body2="b" anchor="0 0 0"/>'
    body = '<body name="{n}"><inertial pos="0 0 .1" mass="1" diaginertia=".1 .1 .1"/><joint name="j{n}" axis="0 1 0"/>'
    (tmp_path / "tied.xml").write_text(
        mujoco.format(a=body.format(n="a") + "</body>", b=body.format(n="b") + "</body>") + "</equality></mujoco>"
    )
    for path in (
        write_urdf(tmp_path, *links, *closed),
        write_sdf(
            tmp_path, *(sdf_joint(*j) for j in (("1", "base", "a"), ("2", "a", "b"), ("3", "b", "c"), ("4", "c", "a")))
        ),
        tmp_path / "tied.xml",
    ):
        with pytest.raises(ModelError, match="loop") as told:
            RobotModel(path, effort_limits={} if path.suffix != ".xml" else [1.0, 1.0])
        assert "\n" not in str(told.value)


def test_limits_the_wrong_way_round_are_told(tmp_path):
    """Drake would end the process."""
    path = write_urdf(tmp_path, *ARM[:4], joint("j2", "a", "b").replace('lower="-2"', 'lower="3"'))
    with pytest.raises(ModelError, match="joint 'j2' has its lower limit 3 above its upper one 2"):
        RobotModel(path)


def test_mjcf_with_velocity_limits_given(tmp_path):
    """Which its format does not know; damping, dry friction and reflected inertia are read."""
    path = tmp_path / "arm.xml"
    body = '<inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
    path.write_text(
        f'<mujoco model="m"><worldbody><body name="a">{body}<joint name="j1" axis="0 1 0" range="-90 90" damping="3" '
        f'frictionloss="0.5" armature="0.1"/><body name="b" pos="0 0 0.3">{body}<joint name="j2" axis="0 1 0"/></body>'
        '</body></worldbody><actuator><motor joint="j1" forcerange="-30 30"/></actuator></mujoco>'
    )
    robot = RobotModel(path, velocity_limits=[1.5, 2.0], effort_limits={"j2": 10.0})
    assert (robot.v_max.tolist(), robot.tau_max.tolist()) == ([1.5, 2.0], [30.0, 10.0])
    assert (robot.viscous.tolist(), robot.coulomb.tolist()) == ([3.0, 0.0], [0.5, 0.0])
    assert robot.tree.armature[0] == pytest.approx(0.1)
    for bad in ([1.0], [1.0, 0.0], [1.0, np.nan]):
        with pytest.raises(ModelError, match="velocity_limits"):
            RobotModel(path, effort_limits=[1.0, 1.0], velocity_limits=bad)


def test_sdf_with_a_prefix_that_nothing_declares(tmp_path):
    """Drake reads its own tags so."""
    path = write_sdf(tmp_path, *(sdf_joint(*j) for j in (("1", "base", "a"), ("2", "a", "b"), ("3", "b", "c"))))
    path.write_text(path.read_text().replace("</link>", "<drake:nothing/></link>", 1).replace("<drake:nothing/>", ""))
    shape = "<collision name='s'><geometry><sphere><radius>.1</radius></sphere></geometry><drake:proximity_properties/>"
    path.write_text(path.read_text().replace("</link>", f"{shape}</collision></link>", 1))
    assert RobotModel(path).n == 3


# ---- packages ------------------------------------------------------------------------------------------------------


def test_package_folders_come_before_drakes_own(tmp_path):
    """A folder of the user's that is named as one of Drake's; one above the file; one that does not exist."""
    own = tmp_path / "mine" / "drake"
    own.mkdir(parents=True)
    (own / "package.xml").write_text("<package><name>drake</name></package>")
    model = tmp_path / "my_arm" / "urdf" / "arm.urdf"
    model.parent.mkdir(parents=True)
    model.write_text('<robot name="r"><mesh filename="package://my_arm/a.obj"/></robot>')
    parser = Parser(MultibodyPlant(0.0))
    add_packages(parser, model, [tmp_path / "mine"])
    assert parser.package_map().GetPath("drake").rstrip("/") == str(own)
    assert parser.package_map().GetPath("my_arm") == str(tmp_path / "my_arm")
    with pytest.raises(ModelError, match="no folder of packages"):
        RobotModel(LWR4, package_dirs=[tmp_path / "nowhere"])
