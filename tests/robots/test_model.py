"""RobotModel reads what the file says, and names what it lacks."""

import numpy as np
import pytest
from arms import EXAMPLES, TILTED, joint, link, states, write_urdf
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from saphari_drake.errors import ModelError, StateError, UnknownNameError
from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER
from saphari_drake.robots.catalog import load
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

TWO_LINKS = (link("base", 0), link("a"), link("b"), joint("j1", "base", "a"), joint("j2", "a", "b"))
CUBE = "\n".join(
    [f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.3)]
    + ["f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4"]
)
SDF = """<?xml version="1.0"?>
<sdf version="1.9"><model name="crooked">
  <link name="base"/>
  <link name="a"><pose>0.1 0 0.2 0.3 0.1 0</pose>{inertial}</link>
  <link name="b"><pose>0.2 0.1 0.4 0 0.4 0.2</pose>{inertial}</link>
  <joint name="turn" type="revolute"><pose>0.05 0.02 -0.1 0.2 0 0.5</pose><parent>base</parent><child>a</child>
    <axis><xyz>0 0.6 0.8</xyz><limit><lower>-1</lower><upper>1</upper><effort>7</effort></limit></axis></joint>
  <joint name="slide" type="prismatic"><pose>0.01 0 0 0 0.3 0</pose><parent>a</parent><child>b</child>
    <axis><xyz>1 0 0</xyz><limit><lower>0</lower><upper>0.5</upper><effort>9</effort></limit></axis></joint>
</model></sdf>"""
SDF_INERTIAL = (
    "<inertial><pose>0.02 0.01 0.05 0 0 0.3</pose><mass>1.5</mass>"
    "<inertia><ixx>.03</ixx><iyy>.02</iyy><izz>.025</izz></inertia></inertial>"
)


def two_links(folder, *elements, **options):
    return RobotModel(write_urdf(folder, *(elements or TWO_LINKS)), **options)


def with_shape(folder, geometry):
    collision = f'<collision><origin xyz="0.1 0 0" rpy="0 0.5 0"/><geometry>{geometry}</geometry></collision>'
    return two_links(folder, link("base", 0), link("a", extra=collision), joint("j1", "base", "a")).shapes


# ---- the LWR4 ------------------------------------------------------------------------------------------------------


def test_limits_of_the_lwr4(lwr4):
    position = np.deg2rad([170, 120, 170, 120, 170, 120, 170])
    np.testing.assert_allclose(lwr4.q_max, position, atol=1e-5)
    np.testing.assert_allclose(lwr4.q_min, -position, atol=1e-5)
    np.testing.assert_allclose(lwr4.v_max, np.deg2rad([110, 110, 128, 128, 204, 184, 184]), atol=1e-5)
    np.testing.assert_array_equal(lwr4.tau_max, [176, 176, 100, 100, 100, 38, 38])
    assert np.all((lwr4.q_min < lwr4.home) & (lwr4.home < lwr4.q_max))


def test_inertias_of_the_lwr4_are_physical(lwr4):
    """Positive definite, and no principal moment exceeds the sum of the others."""
    assert np.all(lwr4.tree.mass > 0.0)
    for inertia in lwr4.tree.inertia:
        moments = np.linalg.eigvalsh(inertia)
        assert moments[0] > 0.0
        assert moments[2] <= moments[0] + moments[1]


def test_masses_and_centres_of_the_lwr4(lwr4):
    masses = [2.699943, 4.279339, 2.430329, 2.278023, 2.301160, 1.050387, 0.311125]
    np.testing.assert_allclose(lwr4.tree.mass, masses)
    np.testing.assert_allclose(lwr4.tree.com[4], [-0.000281, 0.017478, 0.074092], atol=1e-12)


def test_shapes_of_the_lwr4_cover_base_and_all_links(lwr4):
    assert set(lwr4.shapes.link) == {-1, *range(7)}


# ---- other arms ----------------------------------------------------------------------------------------------------


def test_panda_of_example_robot_data(load_arm):
    """Its fingers, of which one follows the other, stay; bodies welded to a link are found by name and belong to it."""
    panda = load_arm("panda")
    assert panda.n == 7 and panda.link_index("panda_leftfinger") == 6
    np.testing.assert_array_equal(panda.tau_max, [87, 87, 87, 87, 12, 12, 12])
    assert panda.link_index("panda_hand") == panda.link_index("panda_link7") == 6
    assert panda.tree.mass[6] > 1.0  # hand and flange, which have no joint of their own
    assert panda.frame("panda_link0")[0] == -1


def test_mobile_base_is_a_chain_of_joints(load_arm):
    robot = load_arm("mobile")
    assert robot.joint_names == ("x", "y", "theta", "shoulder", "elbow")
    np.testing.assert_array_equal(robot.tree.parent, [-1, 0, 1, 2, 3])
    assert robot.link_index("tool") == 4


def test_sdf_with_frames_in_all_places(tmp_path):
    """Joint frames that are neither at the parent nor at the child."""
    path = tmp_path / "crooked.sdf"
    path.write_text(SDF.format(inertial=SDF_INERTIAL))
    robot = RobotModel(path, X_WB=TILTED)
    np.testing.assert_array_equal(robot.tau_max, [7.0, 9.0])
    plant = MultibodyPlant(0.0)
    robot.add_to(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for q, v in states(robot, 20):
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        terms = evaluate_dynamics(robot, q, v)
        np.testing.assert_allclose(terms.M, plant.CalcMassMatrix(context), atol=1e-12)
        np.testing.assert_allclose(terms.Cv, plant.CalcBiasTerm(context), atol=1e-12)
        np.testing.assert_allclose(terms.g, -plant.CalcGravityGeneralizedForces(context), atol=1e-12)
        pose = plant.GetFrameByName("b").CalcPoseInWorld(context)
        np.testing.assert_allclose(terms.p_WL[1], pose.translation(), atol=1e-12)
        np.testing.assert_allclose(terms.R_WL[1], pose.rotation().matrix(), atol=1e-12)


def transmission(name, rotor, gear):
    return (
        f'<transmission type="SimpleTransmission"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="{name}"/><actuator name="{name}"><drake:rotor_inertia value="{rotor}"/>'
        f'<drake:gear_ratio value="{gear}"/></actuator></transmission>'
    )


@pytest.fixture
def geared(tmp_path):
    """Two links whose actuators are listed last joint first, with rotors."""
    path = write_urdf(tmp_path, *TWO_LINKS, transmission("j2", 2e-5, 100), transmission("j1", 1e-5, 50))
    path.write_text(path.read_text().replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" '))
    return RobotModel(path)


def test_actuators_in_another_order_than_joints(geared):
    """u[actuator_order] of torques in joint order drives the joints that are meant."""
    np.testing.assert_array_equal(geared.actuator_order, [1, 0])
    plant = MultibodyPlant(0.0)
    geared.add_to(plant)
    plant.Finalize()
    tau = np.array([3.0, -5.0])
    np.testing.assert_array_equal(plant.MakeActuationMatrix() @ tau[geared.actuator_order], tau)


def test_reflected_rotor_inertia_is_part_of_m_and_p(geared):
    plant = MultibodyPlant(0.0)
    geared.add_to(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for q, v in states(geared, 5):
        plant.SetPositions(context, q)
        terms = evaluate_dynamics(geared, q, v)
        np.testing.assert_allclose(terms.M, plant.CalcMassMatrix(context), atol=1e-12)
        np.testing.assert_allclose(terms.p, terms.M @ v, atol=1e-12)
    np.testing.assert_allclose(geared.tree.armature, [1e-5 * 50**2, 2e-5 * 100**2])


def test_each_joint_has_one_actuator(lwr4):
    """One that the file gives by a transmission is used, not doubled."""
    plant = MultibodyPlant(0.0)
    lwr4.add_to(plant)
    plant.Finalize()
    np.testing.assert_array_equal(plant.MakeActuationMatrix(), np.eye(7))
    np.testing.assert_array_equal(lwr4.actuator_order, np.arange(7))


# ---- files that cannot be used -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("garbage.urdf", "no <xml", "garbage.urdf"),
        ("empty.urdf", "", "empty.urdf"),
        ("joints.urdf", '<robot name="r"/>', "no revolute or prismatic joint"),
        ("two.sdf", '<sdf version="1.9"><model name="a"><link name="l"/></model><model name="b"/></sdf>', "two.sdf"),
        ("arm.txt", '<robot name="r"/>', "arm.txt"),
    ],
)
def test_file_that_does_not_parse(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ModelError, match=message):
        RobotModel(path)


def test_missing_file(tmp_path):
    with pytest.raises(ModelError, match=r"no model file .*nowhere.urdf"):
        RobotModel(tmp_path / "nowhere.urdf")


def test_unknown_robot_name_lists_the_catalog():
    with pytest.raises(UnknownNameError, match="lwr4"):
        load("lwr5")


def test_another_home_is_another_robot(lwr4):
    """A home that is given replaces that of the catalog or file; nothing changes the robot that it was taken from."""
    before, home = lwr4.home.copy(), np.linspace(0.1, 0.7, 7)
    other = lwr4.with_home(home)
    for robot in (other, load("lwr4", home=home), load(str(lwr4.path), home=home)):
        np.testing.assert_array_equal(robot.home, home)
    home[0] = 9.0
    assert other.home[0] == 0.1 and other.shapes.count == lwr4.shapes.count
    np.testing.assert_array_equal(lwr4.home, before)
    np.testing.assert_array_equal(load("lwr4").home, before)
    np.testing.assert_array_equal(load(str(lwr4.path)).home, np.zeros(7))
    with pytest.raises(StateError, match="home: lwr4 has 7 joints"):
        load("lwr4", home=[0.0, 1.0])
    with pytest.raises(StateError, match="home"):
        lwr4.with_home([np.nan] * 7)


def test_moving_link_without_inertia_is_named(tmp_path):
    elements = (link("base", 0), link("a"), link("b", 0), joint("j1", "base", "a"), joint("j2", "a", "b"))
    with pytest.raises(ModelError, match=r"moving link b$"):
        two_links(tmp_path, *elements)


def test_mass_without_moment_about_its_joint_is_named(tmp_path):
    """A point mass on the joint's axis would leave M without an inverse."""
    point = link("b", 1.0, com="0 0 0.1", inertia=0)
    with pytest.raises(ModelError, match=r"moving link b$"):
        two_links(tmp_path, link("base", 0), link("a"), point, joint("j1", "base", "a"), joint("j2", "a", "b"))


def test_joints_without_effort_limit_are_named(tmp_path):
    lacking = joint("j1", "base", "a", effort=""), joint("j2", "a", "b", effort='effort="0"')
    with pytest.raises(ModelError, match=r"effort limit > 0 for j1, j2"):
        two_links(tmp_path, link("base", 0), link("a"), link("b"), *lacking)


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joint_with_more_degrees_of_freedom_is_refused(tmp_path, kind):
    with pytest.raises(ModelError, match=f"{kind}"):
        two_links(tmp_path, link("base", 0), link("a"), joint("j1", "base", "a", kind))


def test_ball_joint_is_refused(tmp_path):
    path = tmp_path / "ball.sdf"
    path.write_text(SDF.format(inertial=SDF_INERTIAL).replace('type="prismatic"', 'type="ball"'))
    with pytest.raises(ModelError, match="'slide' is ball"):
        RobotModel(path)


def test_loose_body_is_refused(tmp_path):
    with pytest.raises(ModelError, match="loose"):
        two_links(tmp_path, *TWO_LINKS, link("loose"))


def test_base_pose_of_a_model_that_fixes_itself_is_refused():
    """It would have no effect."""
    path = EXAMPLES / "xarm_description" / "urdf" / "xarm7.urdf"
    with pytest.raises(ModelError, match="X_WB"):
        RobotModel(path, X_WB=TILTED)
    assert RobotModel(path, X_WB=RigidTransform()).n == 7


# ---- arguments -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "expected"), [({"j2": 5.0}, [20.0, 5.0]), ([3.0, 4.0], [3.0, 4.0]), (np.array([3, 4]), [3.0, 4.0])]
)
def test_effort_limits_replace_those_of_the_file(tmp_path, given, expected):
    """They reach the plant too."""
    robot = two_links(tmp_path, effort_limits=given)
    np.testing.assert_array_equal(robot.tau_max, expected)
    plant = MultibodyPlant(0.0)
    instance = robot.add_to(plant)
    plant.Finalize()
    actuators = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices(instance)]
    np.testing.assert_array_equal([a.effort_limit() for a in actuators], np.array(expected)[robot.actuator_order])


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"elbow": 5.0}, UnknownNameError, "no joint 'elbow'; there are: j1, j2"),
        ([5.0], ModelError, r"needs 2 entries \(j1, j2\)"),
        (5.0, ModelError, "needs 2 entries"),
        ({"j1": -1.0}, ModelError, "for j1"),
        ([1.0, np.nan], ModelError, "for j2"),
    ],
)
def test_bad_effort_limits(tmp_path, given, error, message):
    with pytest.raises(error, match=message):
        two_links(tmp_path, effort_limits=given)


@pytest.mark.parametrize(("home", "message"), [([0.1], "2 joints"), ([0.1, np.nan], "not finite"), (0.1, "2 joints")])
def test_bad_home_posture(tmp_path, home, message):
    with pytest.raises(StateError, match=f"home.*{message}"):
        two_links(tmp_path, home=home)


def test_home_posture_is_given_or_the_default_of_the_file(tmp_path):
    np.testing.assert_array_equal(two_links(tmp_path).home, [0.0, 0.0])
    np.testing.assert_array_equal(two_links(tmp_path, home=[0.1, 0.2]).home, [0.1, 0.2])


@pytest.mark.parametrize("kind", ["link", "joint", "frame"])
def test_unknown_name_lists_what_exists(lwr4, kind):
    question = {"link": lwr4.link_index, "joint": lwr4.joint_index, "frame": lwr4.frame}[kind]
    with pytest.raises(UnknownNameError, match=r"no .* 'elbow'; there are: .*_1, .*_7") as caught:
        question("elbow")
    assert caught.value.kind == kind


def test_root_is_no_moving_link(lwr4):
    with pytest.raises(UnknownNameError):
        lwr4.link_index("base")


# ---- shapes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("geometry", "kind", "size"),
    [
        ('<sphere radius="0.1"/>', CAPSULE, [0.1, 0.0, 0.0]),
        ('<capsule radius="0.1" length="0.4"/>', CAPSULE, [0.1, 0.2, 0.0]),
        ('<cylinder radius="0.1" length="0.4"/>', CYLINDER, [0.1, 0.2, 0.0]),
        ('<box size="0.2 0.4 0.6"/>', BOX, [0.1, 0.2, 0.3]),
    ],
)
def test_collision_shapes_become_primitives(tmp_path, geometry, kind, size):
    shapes = with_shape(tmp_path, geometry)
    assert (shapes.count, shapes.link[0], shapes.kind[0]) == (1, 0, kind)
    np.testing.assert_allclose(shapes.size[0], size)
    np.testing.assert_allclose(shapes.p_LS[0], [0.1, 0.0, 0.0])
    np.testing.assert_allclose(shapes.R_LS[0] @ [0, 0, 1], [np.sin(0.5), 0, np.cos(0.5)])


def test_mesh_becomes_the_box_around_it(tmp_path):
    (tmp_path / "cube.obj").write_text(CUBE)
    shapes = with_shape(tmp_path, '<mesh filename="cube.obj"/>')
    assert shapes.kind[0] == BOX
    np.testing.assert_allclose(shapes.size[0], [0.05, 0.1, 0.15])
    centre = np.array([0.1, 0.0, 0.0]) + shapes.R_LS[0] @ [0.05, 0.1, 0.15]
    np.testing.assert_allclose(shapes.p_LS[0], centre)


def test_shapes_in_the_world_follow_their_links(lwr4):
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    shapes = lwr4.shapes
    R, p = shapes.in_world(terms.R_WL, terms.p_WL)
    for s, carrier in enumerate(shapes.link):
        X_WL = (np.eye(3), np.zeros(3)) if carrier < 0 else (terms.R_WL[carrier], terms.p_WL[carrier])
        np.testing.assert_allclose(R[s], X_WL[0] @ shapes.R_LS[s], atol=1e-12)
        np.testing.assert_allclose(p[s], X_WL[1] + X_WL[0] @ shapes.p_LS[s], atol=1e-12)


def test_no_collision_geometry(tmp_path):
    """The arm can be controlled; only who needs its surface gets the error."""
    robot = two_links(tmp_path)
    with pytest.raises(ModelError, match="no collision geometry"):
        _ = robot.shapes


@pytest.mark.parametrize(
    ("mass", "moments", "words"),
    [("-1", "1 1 1", "mass -1"), ("1", "1 1 3", "no body has"), ("1", "1 1 -1", "no body has")],
)
@pytest.mark.parametrize("form", ["urdf", "sdf"])
def test_an_unphysical_inertia_is_refused_not_replaced(tmp_path, form, mass, moments, words):
    """Negative mass, negative moment and the triangle inequality; Drake would go on with a ball of water."""
    xx, yy, zz = moments.split()
    if form == "urdf":
        inertial = f"<mass value='{mass}'/><inertia ixx='{xx}' iyy='{yy}' izz='{zz}' ixy='0' ixz='0' iyz='0'/>"
        text = (
            f"<robot name='r'><link name='base'/><link name='arm'><inertial>{inertial}</inertial></link>"
            "<joint name='j' type='revolute'><parent link='base'/><child link='arm'/><axis xyz='0 0 1'/>"
            "<limit lower='-1' upper='1' velocity='1' effort='10'/></joint></robot>"
        )
    else:
        inertial = f"<mass>{mass}</mass><inertia><ixx>{xx}</ixx><iyy>{yy}</iyy><izz>{zz}</izz></inertia>"
        text = (
            f"<sdf version='1.9'><model name='r'><link name='base'/><link name='arm'><inertial>{inertial}</inertial>"
            "</link><joint name='j' type='revolute'><parent>base</parent><child>arm</child><axis><xyz>0 0 1</xyz>"
            "<limit><effort>10</effort></limit></axis></joint></model></sdf>"
        )
    path = tmp_path / f"robot.{form}"
    path.write_text(text)
    with pytest.raises(ModelError, match=f"'?arm.*{words}|{words}"):
        RobotModel(path)
