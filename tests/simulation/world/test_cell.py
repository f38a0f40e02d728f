"""The cell's physics: statics of the hand on the held robot, stiffness of its tissue, what collides with what."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.tree import JointIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.errors import ParameterError
from saphari_drake.robots.catalog import lwr4
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.pushing_hand import HumanHand, Push, find_target
from saphari_drake.simulation.world.cell import CellParameters, add_cell, contact_truth
from saphari_drake.simulation.world.hand_and_floor import HandParameters


def pressed(force, hand=None, seconds=1.5):
    """Press a hand along −y on link 6 of a locked robot; return cell, simulator and contact."""
    robot = lwr4()
    robot.home = np.deg2rad([90.0, -30.0, 0.0, 60.0, 0.0, -90.0, 0.0])
    push = Push("link_6", direction=[0.0, -1.0, 0.0], force=force, start=0.0, hold=10.0)
    builder = DiagramBuilder()
    params = CellParameters(hand=hand or HandParameters())
    cell = add_cell(builder, robot, params)
    start = cell.hand.floating_velocities_start_in_v()
    person = builder.AddSystem(HumanHand(robot, params.hand, [push], cell.plant.num_velocities(), start))
    cell.plant.SetDefaultFloatingBaseBodyPose(cell.hand, person.start_pose())
    gravity = evaluate_dynamics(robot, robot.home, np.zeros(7)).g
    source = builder.AddSystem(ConstantVectorSource(gravity))
    builder.Connect(source.get_output_port(), cell.torque_input)
    builder.Connect(cell.hand_state, person.GetInputPort("hand_state"))
    builder.Connect(cell.robot_state, person.GetInputPort("robot_state"))
    builder.Connect(person.get_output_port(), cell.hand_force_input)
    simulator = Simulator(builder.Build())
    context = cell.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for index in cell.plant.GetJointIndices(cell.instance):
        joint = cell.plant.get_joint(JointIndex(index))
        if joint.num_velocities():
            joint.Lock(context)
    simulator.AdvanceTo(seconds)
    results = cell.plant.get_contact_results_output_port().Eval(context)
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
    robot = lwr4()
    robot.home = np.deg2rad([0.0, 110.0, 0.0, 115.0, 0.0, -110.0, 0.0])
    builder = DiagramBuilder()
    cell = add_cell(builder, robot)
    gravity = evaluate_dynamics(robot, robot.home, np.zeros(7)).g
    source = builder.AddSystem(ConstantVectorSource(gravity))
    rest = builder.AddSystem(ConstantVectorSource(np.zeros(cell.plant.num_velocities())))
    builder.Connect(source.get_output_port(), cell.torque_input)
    builder.Connect(rest.get_output_port(), cell.hand_force_input)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = cell.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    cell.plant.SetFreeBodyPose(context, cell.hand, far_away())
    simulator.AdvanceTo(0.05)
    state = cell.robot_state.Eval(context)
    np.testing.assert_allclose(state, np.r_[robot.home, np.zeros(7)], atol=1e-6)


def far_away():
    return RigidTransform([2.0, 2.0, 2.0])


def test_the_hand_carries_its_own_weight():
    """Gravity does not move a hand that nobody moves."""
    builder = DiagramBuilder()
    cell = add_cell(builder, lwr4())
    rest = builder.AddSystem(ConstantVectorSource(np.zeros(cell.plant.num_velocities())))
    builder.Connect(rest.get_output_port(), cell.hand_force_input)
    zero = builder.AddSystem(ConstantVectorSource(np.zeros(7)))
    builder.Connect(zero.get_output_port(), cell.torque_input)
    simulator = Simulator(builder.Build())
    context = cell.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    cell.plant.SetFreeBodyPose(context, cell.hand, far_away())
    simulator.AdvanceTo(0.1)
    np.testing.assert_allclose(cell.hand_state.Eval(context)[4:7], [2.0, 2.0, 2.0], atol=1e-9)


@pytest.mark.parametrize("field", ["finger_radius", "mass", "stiffness", "tissue_stiffness"])
def test_bad_hand_parameters_are_named(field):
    """A hand without size, mass or stiffness is refused."""
    with pytest.raises(ParameterError, match=field):
        HandParameters(**{field: 0.0})
    with pytest.raises(ParameterError, match=field):
        HandParameters(**{field: float("nan")})
