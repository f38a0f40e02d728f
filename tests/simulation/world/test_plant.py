"""The simulated robot: friction sticks, a payload weighs, torques reach their joints."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.robots.attached import ModelOptions
from saphari_drake.robots.catalog import REPORTED, load, reported_friction
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.plant import PlantParameters, joint_friction
from saphari_drake.simulation.world.profile import PlantProfile, Truth


def moved(robot, params, more, seconds=0.1, truth=None):
    """Give the joints what holds the robot's own weight, and more (Nm); return the joint velocities at the end."""
    builder = DiagramBuilder()
    cell = add_cell(builder, robot, plant=params, truth=truth)
    builder.ExportInput(cell.torque_input, "torque")
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    gravity = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).g
    simulator.get_system().get_input_port(0).FixValue(context, gravity + more)
    simulator.AdvanceTo(seconds)
    return cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(context))[robot.n :]


@pytest.mark.parametrize("joint", range(7))
def test_each_torque_reaches_its_joint_with_and_without_brakes(lwr4, joint):
    """A torque moves its own joint its own way; beyond the Coulomb friction of all joints, it alone."""
    params = PlantParameters(friction_share=1.0)
    more = np.zeros(7)
    more[joint] = 1.0
    assert moved(lwr4, PlantParameters(), more, 0.002)[joint] > 1e-5
    v = moved(lwr4, params, (REPORTED["coulomb"][joint] + 20.0) * more)
    assert np.argmax(np.abs(v)) == joint and v[joint] > 1e-3


def test_a_joint_sticks_below_its_coulomb_friction(lwr4):
    """0.8 of it moves no joint; without friction the same torques do."""
    params = PlantParameters(friction_share=0.5)
    more = 0.8 * 0.5 * np.array(REPORTED["coulomb"]) * [1, -1, 1, -1, 1, -1, 1]
    assert np.abs(moved(lwr4, params, more)).max() < 1e-3
    assert np.abs(moved(lwr4, PlantParameters(), more)).max() > 0.1


def test_a_payload_weighs_where_it_is(lwr4):
    """The robot rests with Jᵀ m g more in its joints, and falls without."""
    params, mass = PlantParameters(payload=2.0), 2.0
    J = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).point(6, np.array([0.0, 0.0, 0.05])).Jv_WC
    held = J.T @ [0.0, 0.0, 9.81 * mass]
    assert np.abs(moved(lwr4, params, held)).max() < 1e-6
    assert np.abs(moved(lwr4, params, 0.0 * held)).max() > 0.05


def test_a_profile_s_friction_holds_and_slows(lwr4):
    """0.29 Nm on the last joint moves nothing at 0.3 Nm Coulomb; beyond, viscous friction leaves (τ − c)/d."""
    more = np.zeros(7)
    more[6] = 0.29
    truth = Truth(PlantProfile(coulomb=0.3, viscous=1.0))
    assert np.abs(moved(lwr4, PlantParameters(), more, 0.1, truth)).max() < 1e-4
    more[6] = 0.5
    assert moved(lwr4, PlantParameters(), more, 0.3, truth)[6] == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize("name", ["lwr4", "panda", "mobile"])
def test_friction_that_is_not_stated_fits_any_number_of_joints(load_arm, name):
    """As reported for the LWR4; of other arms as large a share of the torque limits in the mean."""
    robot = load_arm(name)
    dry, damping = joint_friction(robot, PlantParameters(friction_share=1.0), Truth())
    assert np.mean(dry / robot.tau_max) == pytest.approx(0.09607, rel=1e-3)
    assert np.mean((damping - robot.viscous) / robot.tau_max) == pytest.approx(0.06982, rel=1e-3)
    if name == "lwr4":
        np.testing.assert_array_equal(dry, REPORTED["coulomb"])


def test_reported_friction_is_that_of_the_robot_whatever_its_torque_limits():
    weak = load("lwr4", options=ModelOptions(effort_limits=[20.0] * 7))
    assert not np.array_equal(weak.tau_max, load("lwr4").tau_max)
    np.testing.assert_array_equal(reported_friction(weak, "viscous"), REPORTED["viscous"])
