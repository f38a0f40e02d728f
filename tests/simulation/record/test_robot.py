"""What is recorded of a robot in a cell."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.robots.catalog import omnirob
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.robot import record_limits, record_robot
from saphari_drake.simulation.runner.simulation import Simulation
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.simulation.world.pushing_hand import PushingHand


def recorded(robot, bodies):
    """Record a robot that holds its weight but for a push at its last joint; return log, fast log and final state."""
    builder = DiagramBuilder()
    cell = add_cell(builder, robot, bodies, PlantParameters(time_step=0.002))
    torque = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).g
    torque[-1] += 0.1
    source = builder.AddSystem(ConstantVectorSource(torque))
    builder.Connect(source.get_output_port(), cell.torque_input)
    recorder, fast = record_robot(builder, cell, 0.01), record_limits(builder, cell, source.get_output_port())
    run = Simulation(builder.Build())
    state = cell.plant.get_state_output_port().Eval(cell.plant.GetMyContextFromRoot(run.to(0.05)))
    return run.log(recorder), run.log(fast), state


def test_state_of_the_robot_and_of_all_that_moves(lwr4):
    """Position, velocity and the whole plant's positions are the plant's own; every step for the limits."""
    log, fast, state = recorded(lwr4, [PushingHand([Push("link_6", direction=[0.0, -1.0, 0.0])])])
    np.testing.assert_array_equal(log["plant_position"][-1], state[:14])
    np.testing.assert_array_equal(log["position"][-1], state[:7])
    np.testing.assert_array_equal(log["velocity"][-1], fast["velocity"][-1])
    assert len(fast.time) == 26 and np.abs(log["velocity"][-1, 6]) > 0.0
    assert log.units["velocity"] == "rad/s" and fast.units["torque_excess"] == "Nm"


def test_a_robot_alone_has_no_other_positions_and_its_units():
    log, fast, state = recorded(omnirob(), [])
    assert "plant_position" not in log
    np.testing.assert_array_equal(log["position"][-1], state[:10])
    assert log.units["position"] == "rad, m" and fast.units["torque_excess"] == "Nm, N"
