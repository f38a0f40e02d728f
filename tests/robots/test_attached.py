"""A tool and a load are part of the robot, in its own dynamics as in every plant that it is added to."""

import numpy as np
import pytest
from arms import joint, link, states, write_urdf
from pydrake.multibody.plant import MultibodyPlant

from saphari_drake.errors import ModelError, ParameterError, UnknownNameError
from saphari_drake.robots.attached import ModelOptions, Payload, Tool
from saphari_drake.robots.catalog import load, models_dir
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

LWR4 = models_dir() / "lwr4" / "lwr4.urdf"


@pytest.fixture(scope="module")
def gripper(tmp_path_factory):
    """A hand with one finger that slides."""
    shape = '<collision><geometry><sphere radius="0.03"/></geometry></collision>'
    parts = link("palm", 1.5, extra=shape), link("finger", 0.5), joint("slide", "palm", "finger", "prismatic", "1 0 0")
    return write_urdf(tmp_path_factory.mktemp("tool"), *parts, name="gripper")


def agrees_with_its_plant(robot):
    """Whether M and g are those of the plant that the robot is added to."""
    plant = MultibodyPlant(0.0)
    robot.add_to(plant)
    plant.Finalize()
    assert plant.num_positions() == robot.n
    context = plant.CreateDefaultContext()
    for q, v in states(robot, 5):
        plant.SetPositions(context, q)
        terms = evaluate_dynamics(robot, q, v)
        np.testing.assert_allclose(terms.M, plant.CalcMassMatrix(context), atol=1e-12)
        np.testing.assert_allclose(terms.g, -plant.CalcGravityGeneralizedForces(context), atol=1e-12)


def test_a_tool_and_a_load_are_in_the_dynamics(gripper, lwr4):
    tool = Tool(str(gripper), pose=[0.0, 0.0, 0.1, 0.0, 90.0, 30.0], joints={"slide": 0.2})
    robot = RobotModel(LWR4, attached=[tool, Payload(2.0, [0.0, 0.1, 0.05], frame="link_6")])
    agrees_with_its_plant(robot)
    assert robot.tree.mass.sum() == pytest.approx(lwr4.tree.mass.sum() + 4.0)
    assert robot.tree.mass[5] == pytest.approx(lwr4.tree.mass[5] + 2.0)
    assert robot.link_index("palm") == robot.link_index("finger") == 6
    assert np.sum(robot.shapes.link == 6) == np.sum(lwr4.shapes.link == 6) + 1
    # The weight of a load at rest is m g times the horizontal way from the axis that carries it.
    heavy, q = RobotModel(LWR4, attached=[Payload(2.0, [0.0, 0.0, 0.1])]), np.array([0.0, np.pi / 2, 0, 0, 0, 0, 0])
    more = evaluate_dynamics(heavy, q, np.zeros(7)).g - evaluate_dynamics(lwr4, q, np.zeros(7)).g
    lever = heavy.kinematics(q).position(6, np.array([0.0, 0.0, 0.1]))[0]
    assert abs(more[1]) == pytest.approx(2.0 * 9.81 * abs(lever), abs=1e-9)


def test_where_the_tools_joint_stays_counts(gripper):
    near, far = (RobotModel(LWR4, attached=[Tool(str(gripper), joints={"slide": x})]) for x in (0.0, 0.3))
    assert np.linalg.norm(far.tree.com[6] - near.tree.com[6]) == pytest.approx(0.3 * 0.5 / near.tree.mass[6])


def test_options_of_a_scenario_reach_the_model(gripper):
    options = ModelOptions(joints=["joint_[1-6]"], effort_limits=[9.0] * 6, velocity_limits=[2.0] * 6)
    options.payload, options.tool = Payload(1.0), Tool(str(gripper))
    robot = load("lwr4", options=options)
    assert robot.n == 6 and robot.link_names[-1] == "link_6"
    np.testing.assert_array_equal(robot.tau_max, [9.0] * 6)
    np.testing.assert_array_equal(robot.v_max, [2.0] * 6)
    assert robot.link_index("palm") == robot.link_index("link_7") == 5
    agrees_with_its_plant(robot)


@pytest.mark.parametrize(
    ("made", "error", "message"),
    [
        (lambda: Payload(-1.0), ParameterError, "mass"),
        (lambda: Payload(1.0, [0.0, np.nan, 0.0]), ParameterError, "centre"),
        (lambda: Payload(1.0, inertia=[1.0, 1.0, 3.0]), ParameterError, "no body"),
        (lambda: Payload(1.0, inertia=[1.0]), ParameterError, "inertia"),
        (lambda: Tool("nowhere.urdf"), ParameterError, "no model file"),
        (lambda: Tool(pose=[0.0]), ParameterError, "pose"),
        (lambda: ModelOptions(effort_limits=[-1.0]), ParameterError, "effort_limits"),
        (lambda: RobotModel(LWR4, attached=[Payload(1.0, frame="nose")]), UnknownNameError, "no frame 'nose'"),
        (lambda: RobotModel(LWR4, attached=[Tool(__file__)]), ModelError, "test_attached.py"),
    ],
)
def test_bad_attachments_are_told(made, error, message):
    with pytest.raises(error, match=message):
        made()
