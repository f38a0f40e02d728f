"""The person's hand: targets on the surface, from outside, and clear words where that is not possible."""

import numpy as np
import pytest

from saphari_drake.errors import ModelError, ParameterError, UnknownNameError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.robots.catalog import lwr4
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.pushing_hand import HumanHand, Push, find_target
from saphari_drake.simulation.world.hand import HandParameters

HOME = np.deg2rad([90.0, -30.0, 0.0, 60.0, 0.0, -90.0, 0.0])


@pytest.fixture(scope="module")
def robot():
    model = lwr4()
    model.home = HOME
    return model


@pytest.mark.parametrize(
    "link, aim, direction",
    [
        ("link_3", [0.0, 0.0, 0.10], [1.0, 0.0, 0.0]),
        ("link_4", [0.0, 0.0, 0.12], [0.0, 0.0, -1.0]),
        ("link_5", [0.0, 0.0, 0.10], [-1.0, 0.0, 0.0]),
        ("link_6", [0.0, 0.0, 0.0], [0.0, -1.0, 0.0]),
    ],
)
def test_target_is_on_the_link_s_surface_and_seen_from_outside(robot, link, aim, direction):
    """The target is at distance zero, on the link, its normal against the push, with a free way to it."""
    target = find_target(robot, HOME, Push(link, aim, direction))
    terms = evaluate_dynamics(robot, HOME, np.zeros(7))
    shapes = robot.shapes
    R, p = shapes.in_world(terms.R_WL, terms.p_WL)
    everything = np.ones(shapes.count, dtype=bool)
    shape, distance, _, normal = nearest_surface_point(shapes.kind, shapes.size, R, p, everything, target.p_WT)
    assert abs(distance) < 1e-4
    assert robot.link_names[shapes.link[shape]] == link
    assert normal @ target.direction < -0.1
    for back in np.linspace(0.02, 0.9, 20):
        point = target.p_WT - back * target.direction
        assert nearest_surface_point(shapes.kind, shapes.size, R, p, everything, point)[1] > 0.0


def test_finger_points_where_it_is_told(robot):
    """The hand's x axis is the push, or the direction given for the finger."""
    plain = find_target(robot, HOME, Push("link_6", direction=[0.0, -2.0, 0.0]))
    np.testing.assert_allclose(plain.R_WH[:, 0], [0.0, -1.0, 0.0], atol=1e-12)
    slanted = find_target(robot, HOME, Push("link_6", direction=[0.0, -1.0, 0.0], finger=[0.0, -1.0, -1.0]))
    np.testing.assert_allclose(slanted.R_WH[:, 0], np.array([0.0, -1.0, -1.0]) / np.sqrt(2.0), atol=1e-12)
    np.testing.assert_allclose(slanted.R_WH @ slanted.R_WH.T, np.eye(3), atol=1e-12)


def test_a_blocked_way_names_what_is_in_it(robot):
    """A push from the base outwards meets the forearm before the wrist."""
    with pytest.raises(ModelError, match="link_6.*meets link_"):
        find_target(robot, HOME, Push("link_6", direction=[0.0, 1.0, 0.0]))


def test_a_push_beside_the_link_says_so(robot):
    """Aiming half a metre beside the link misses it."""
    with pytest.raises(ModelError, match="misses link_6"):
        find_target(robot, HOME, Push("link_6", [0.5, 0.5, 0.0], [0.0, 0.0, -1.0]))


def test_an_unknown_link_lists_those_that_exist(robot):
    """The error teaches the names."""
    with pytest.raises(UnknownNameError, match="elbow.*link_1, link_2"):
        find_target(robot, HOME, Push("elbow"))


@pytest.mark.parametrize(
    "field, value",
    [
        ("force", -1.0),
        ("hold", 0.0),
        ("start", -0.1),
        ("aim", [0.0]),
        ("direction", [0.0, 0.0, 0.0]),
        ("finger", [1.0]),
    ],
)
def test_bad_pushes_name_the_field(field, value):
    """Each field is checked."""
    with pytest.raises(ParameterError, match=field):
        Push(**{field: value})


def test_no_push_at_all_is_refused(robot):
    """A script without pushes is a mistake."""
    with pytest.raises(ParameterError, match="pushes"):
        HumanHand(robot, HandParameters(), [], 13, 7)


def test_the_spring_never_pushes_harder_than_it_should(robot):
    """Wherever the hand is stopped on its way, the force along the push is at most that of the push."""
    push = Push("link_6", direction=[0.0, -1.0, 0.0], force=25.0, start=0.0, hold=5.0)
    hand = HumanHand(robot, HandParameters(), [push], 13, 7)
    context = hand.CreateDefaultContext()
    hand.GetInputPort("robot_state").FixValue(context, np.r_[HOME, np.zeros(7)])
    pose = hand.start_pose()
    quaternion = pose.rotation().ToQuaternion().wxyz()
    forces = []
    for time in np.linspace(0.0, 4.0, 50):
        context.SetTime(time)
        state = np.r_[quaternion, pose.translation(), np.zeros(6)]
        hand.GetInputPort("hand_state").FixValue(context, state)
        forces.append(hand.get_output_port().Eval(context)[7:][3:6] @ [0.0, -1.0, 0.0])
    assert max(forces) == pytest.approx(25.0)
    assert min(forces) >= -1e-9
