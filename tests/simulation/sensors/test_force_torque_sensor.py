"""The wrist sensor by itself: sign, range, noise, and what it says before the first step."""

import numpy as np
import pytest
from bench import Bench
from pydrake.multibody.math import SpatialForce
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensor, ForceTorqueSensorParameters
from saphari_drake.simulation.world.cell import add_cell

EXACT = {"noise_force": 0.0, "noise_torque": 0.0, "bias_force": 0.0, "bias_torque": 0.0}


@pytest.fixture(scope="module")
def cell(lwr4):
    return add_cell(DiagramBuilder(), lwr4)


def sensing(cell, size=1.0, **params):
    sensor = ForceTorqueSensor(cell.plant, cell.instance, ForceTorqueSensorParameters(**params))
    return Bench(sensor, reaction_forces=[SpatialForce(size * np.ones(3), size * np.ones(3))] * cell.plant.num_joints())


def test_it_reads_what_the_tool_does_to_the_joint_within_its_range(cell):
    """The opposite of the reaction on the child; what is beyond the range is cut and told."""
    bench = sensing(cell, 4.0, **EXACT, range_torque=10.0, range_force=50.0)
    bench.run(1)
    np.testing.assert_array_equal(bench.read("wrench_sensor"), -4.0)
    assert bench.read("overload") == 0.0
    bench.run(1, reaction_forces=[SpatialForce(30.0 * np.ones(3), 30.0 * np.ones(3))] * cell.plant.num_joints())
    np.testing.assert_array_equal(bench.read("wrench_sensor"), [-10.0] * 3 + [-30.0] * 3)
    assert bench.read("overload") == 1.0


def test_before_the_first_step_there_is_no_reading(cell):
    """The plant gives zeros then; it is no overload either."""
    bench = sensing(cell, 0.0)
    bench.run(1)
    assert np.isnan(bench.read("wrench_sensor")).all()
    assert bench.read("overload") == 0.0


def test_noise_is_reproduced_by_a_clone_and_of_the_stated_size(cell):
    bench = sensing(cell, noise_force=0.1, bias_force=0.0)
    clone, readings = bench.clone(), []
    for k in range(200):
        bench.run(1)
        readings.append(bench.read("wrench_sensor")[3:])
        if k < 20:
            clone.run(1)
            np.testing.assert_array_equal(clone.read("wrench_sensor"), bench.read("wrench_sensor"))
    assert np.std(readings, axis=0).mean() == pytest.approx(0.1, rel=0.15)


def test_bad_names_and_parameters_are_told(cell):
    with pytest.raises(UnknownNameError, match="joint_7"):
        ForceTorqueSensor(cell.plant, cell.instance, ForceTorqueSensorParameters(joint="wrist"))
    for name in ("period", "noise_force", "bias_torque", "range_force", "seed"):
        with pytest.raises(ParameterError, match=name):
            ForceTorqueSensorParameters(**{name: -1})
