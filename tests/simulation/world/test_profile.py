"""Profiles: what a seed draws, which sensors follow, and that the ideal plant is the one without a profile."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import ParameterError
from saphari_drake.robots.catalog import lwr4, omnirob
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.sensors.depth_noise import SamplerParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.profile import PlantProfile, Truth, joint_scale, profile_of, realistic


def fall(truth, seconds=0.2):
    """Let a robot go that is held by its own model's weight; return its state at the end."""
    robot, builder = lwr4(), DiagramBuilder()
    cell = add_cell(builder, robot, truth=truth)
    builder.ExportInput(cell.torque_input, "torque")
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    weight = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).g
    simulator.get_system().get_input_port(0).FixValue(context, 0.9 * weight)
    simulator.AdvanceTo(seconds)
    return cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(context))


def test_the_ideal_plant_is_that_without_a_profile():
    truth = Truth(profile_of("ideal", realistic()), seed=3)
    assert np.array_equal(fall(None), fall(truth))


def test_a_seed_gives_one_plant():
    one, again, other = (fall(Truth(realistic(), seed)) for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert np.abs(one - other).max() > 1e-4


def test_shares_lie_where_they_are_said(lwr4):
    truths = [Truth(realistic(), seed) for seed in range(200)]
    rotor = np.array([truth.rotor_scale(lwr4) for truth in truths])
    mass = np.array([truth.mass_scale(lwr4) for truth in truths])
    assert set(np.round(np.unique(rotor), 9)) == {0.8, 1.2}
    assert 0.95 <= mass.min() < 0.951 and 1.049 < mass.max() <= 1.05


def test_a_prismatic_joint_takes_its_share_of_force():
    scale = joint_scale(omnirob())
    np.testing.assert_allclose(scale[:2], omnirob().tau_max[:2] / 100.0)
    assert np.all(scale[2:] == 1.0)


def test_sensors_follow_the_profile():
    own, camera = JointSensorParameters(0.002, 1e-6, differentiate=False), SamplerParameters(latency=0.01)
    assert Truth().joint_sensor(own) == own and Truth().sampler(camera) == camera
    truth = Truth(realistic())
    sensor = truth.joint_sensor(own)
    assert sensor.position_resolution == pytest.approx(2.0 * np.pi / 65536) and sensor.differentiate
    assert sensor.period == own.period and truth.sampler(camera).latency == 0.03


@pytest.mark.parametrize("name", ["rotor_error", "mass_error", "payload", "viscous", "torque_noise", "torque_delay"])
@pytest.mark.parametrize("value", [np.nan, -1.0])
def test_a_number_that_cannot_be_is_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=name):
        PlantProfile(**{name: value})


def test_a_share_of_one_is_refused():
    with pytest.raises(ParameterError, match="mass_error"):
        PlantProfile(mass_error=1.0)
