"""The cell's physics: statics of the hand on the held robot, stiffness of its tissue, what collides with what."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex, JointIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.robots.catalog import lwr4
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.pushing_hand import Push, find_target
from saphari_drake.simulation.world.cell import add_cell, contact_truth
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.hand import HandParameters
from saphari_drake.simulation.world.pedestal import Pedestal
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.simulation.world.pushing_hand import PushingHand

HOME = np.deg2rad([90.0, -30.0, 0.0, 60.0, 0.0, -90.0, 0.0])


def hold(builder, cell):
    """Let the joints hold the robot's weight."""
    source = builder.AddSystem(ConstantVectorSource(evaluate_dynamics(cell.robot, cell.robot.home, np.zeros(7)).g))
    builder.Connect(source.get_output_port(), cell.torque_input)


def pressed(force, hand=None, seconds=1.5):
    """Press a hand along −y on link 6 of a locked robot; return cell, simulator and contact."""
    robot = lwr4(home=HOME)
    push = Push("link_6", direction=[0.0, -1.0, 0.0], force=force, start=0.0, hold=10.0)
    builder = DiagramBuilder()
    cell = add_cell(builder, robot, [PushingHand([push], hand or HandParameters())])
    hold(builder, cell)
    simulator = Simulator(builder.Build())
    context = cell.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for index in cell.plant.GetJointIndices(cell.instance):
        joint = cell.plant.get_joint(JointIndex(index))
        if joint.num_velocities():
            joint.Lock(context)
    simulator.AdvanceTo(seconds)
    results = cell.contact_results.Eval(context)
    return cell, context, target_of(robot, push), contact_truth(results, cell), results


def target_of(robot, push):
    return find_target(robot, robot.home, push)


def test_the_steady_contact_force_is_the_person_s_push():
    """In balance the robot feels what the spring gives, along the push, at the target."""
    cell, _, target, truth, _ = pressed(20.0)
    np.testing.assert_allclose(truth[:3], [0.0, -20.0, 0.0], atol=0.2)
    assert np.linalg.norm(truth[3:6] - target.p_WT) < 0.003
    assert cell.robot.link_names[int(truth[6])] == "link_6"


@pytest.mark.parametrize("stiffness", [5.0e3, 2.0e4])
def test_the_tissue_has_the_stated_stiffness(stiffness):
    """Penetration is force over stiffness, robot's cover being far stiffer."""
    *_, results = pressed(20.0, HandParameters(tissue_stiffness=stiffness))
    depth = results.point_pair_contact_info(0).point_pair().depth
    assert depth == pytest.approx(20.0 / stiffness, rel=0.05)


def test_no_contact_is_zero_and_names_no_link():
    """Before the hand arrives the truth says so."""
    *_, truth, _ = pressed(20.0, seconds=0.1)
    np.testing.assert_array_equal(truth, [0.0] * 6 + [-1.0])


def test_a_balanced_robot_stays_and_does_not_collide_with_itself():
    """With its gravity torque the folded robot stays at rest: neighbouring links overlap without contact."""
    robot = lwr4(home=np.deg2rad([0.0, 110.0, 0.0, 115.0, 0.0, -110.0, 0.0]))
    moved = []
    for touching in (False, True):
        builder = DiagramBuilder()
        cell = add_cell(builder, robot, plant=PlantParameters(self_contact=touching))
        hold(builder, cell)
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(0.05)
        state = cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(simulator.get_context()))
        moved.append(np.abs(state - np.r_[robot.home, np.zeros(7)]).max())
    assert moved[0] < 1e-6 < moved[1]


def test_the_hand_carries_its_own_weight():
    """Gravity does not move a hand that nobody moves."""
    builder = DiagramBuilder()
    cell = add_cell(builder, lwr4(), [PushingHand()])
    hold(builder, cell)
    simulator = Simulator(builder.Build())
    context, hand = (
        cell.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context()),
        cell.plant.GetBodyByName("hand"),
    )
    cell.plant.SetFreeBodyPose(context, hand, RigidTransform([2.0, 2.0, 2.0]))
    simulator.AdvanceTo(0.1)
    state = cell.plant.get_state_output_port(hand.model_instance()).Eval(context)
    np.testing.assert_allclose(state[4:7], [2.0, 2.0, 2.0], atol=1e-9)


def test_every_body_of_the_robot_belongs_to_its_link():
    """Bodies that move with a link count as that link, its base as none; nothing else is the robot's."""
    cell = add_cell(DiagramBuilder(), lwr4(), [PushingHand(), Floor()], PlantParameters(payload=1.0))
    owner = {cell.plant.get_body(BodyIndex(index)).name(): link for index, link in cell.link_of_body.items()}
    assert owner["link_3"] == 2 and owner["payload"] == 6 and not {"hand", "floor"} & set(owner)
    assert sum(link == -1 for link in owner.values()) >= 1


def test_a_cell_is_shown_elsewhere_as_it_is():
    """Its copy has the same positions, in the same order, and starts where it does."""
    push = Push("link_6", direction=[0.0, -1.0, 0.0])
    cell = add_cell(DiagramBuilder(), lwr4(home=HOME), [PushingHand([push]), Floor()])
    plant = cell.copy_to(DiagramBuilder())
    assert plant.GetPositionNames() == cell.plant.GetPositionNames()
    q = [p.GetPositions(p.CreateDefaultContext()) for p in (plant, cell.plant)]
    np.testing.assert_array_equal(*q)


def test_without_geometry_the_robot_moves_the_same():
    """As it falls; it can be built for files whose meshes are not there."""
    states = []
    for geometry in (True, False):
        builder = DiagramBuilder()
        cell = add_cell(builder, lwr4(), [Floor()], PlantParameters(geometry=geometry))
        simulator = Simulator(builder.Build())
        context = cell.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        cell.torque_input.FixValue(context, np.zeros(7))
        simulator.AdvanceTo(0.05)
        states.append(cell.robot_state.Eval(context))
    np.testing.assert_allclose(*states, atol=1e-12)
    assert np.abs(states[0][7:]).max() > 0.1


@pytest.mark.parametrize(
    "field, value", [("time_step", 0.0), ("friction_share", -0.1), ("payload", np.nan), ("contact_model", "soft")]
)
def test_bad_plant_parameters_are_named(field, value):
    with pytest.raises((ParameterError, UnknownNameError), match=field):
        PlantParameters(**{field: value})


@pytest.mark.parametrize("field", ["finger_radius", "mass", "stiffness", "tissue_stiffness"])
def test_bad_hand_parameters_are_named(field):
    """A hand without size, mass or stiffness is refused."""
    with pytest.raises(ParameterError, match=field):
        HandParameters(**{field: 0.0})
    with pytest.raises(ParameterError, match=field):
        HandParameters(**{field: float("nan")})


def test_a_pedestal_reaches_from_the_floor_to_the_base_and_is_only_seen():
    """The plant moves and collides as without it."""
    plain, cell = (add_cell(DiagramBuilder(), lwr4(), bodies) for bodies in ([], [Pedestal(0.6)]))
    body, inspector = cell.plant.GetBodyByName("pedestal"), cell.scene_graph.model_inspector()
    (shape,) = cell.plant.GetVisualGeometriesForBody(body)
    X_WG = body.EvalPoseInWorld(cell.plant.CreateDefaultContext()) @ inspector.GetPoseInFrame(shape)
    length = inspector.GetShape(shape).length()
    np.testing.assert_allclose(X_WG.translation()[2] + 0.5 * length * np.array([-1.0, 1.0]), [0.0, 0.6], atol=1e-12)
    assert not cell.plant.GetCollisionGeometriesForBody(body)
    assert cell.plant.num_positions() == plain.plant.num_positions()
