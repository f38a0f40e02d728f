"""The tool as it is identified: near to the true one, and left alone where nobody could know."""

import numpy as np
from experiments.guiding.tool import identified_tool, true_tool

from saphari_drake.perception.wrench.tool import sensor_mount
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensorParameters
from saphari_drake.simulation.world.profile import PlantProfile, Truth, realistic

SENSOR = ForceTorqueSensorParameters()


def test_it_finds_what_the_plant_carries(lwr4):
    truth = Truth(realistic(), period=0.002)
    real, model = true_tool(lwr4, truth, SENSOR.joint), sensor_mount(lwr4, SENSOR.joint).tool
    found = identified_tool(lwr4, truth, SENSOR)
    assert real.mass > model.mass + 0.15
    assert abs(found.mass - real.mass) < 0.005
    np.testing.assert_allclose(found.com, real.com, atol=0.003)


def test_true_tool_of_an_ideal_plant_is_the_models(lwr4):
    real, model = true_tool(lwr4, Truth(), SENSOR.joint), sensor_mount(lwr4, SENSOR.joint).tool
    assert np.isclose(real.mass, model.mass) and np.allclose(real.com, model.com)


def test_nothing_is_identified_on_an_ideal_plant_or_under_a_fault(lwr4):
    assert identified_tool(lwr4, Truth(), SENSOR) is None
    assert identified_tool(lwr4, Truth(PlantProfile(payload=1.0), faults={"payload": 0.0}), SENSOR) is None
