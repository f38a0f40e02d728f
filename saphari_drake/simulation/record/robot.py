"""What is recorded of the robot in a cell, in every experiment under the same names."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from saphari_drake.math.tree import REVOLUTE
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.world.cell import Cell


def record_robot(builder: DiagramBuilder, cell: Cell, period: float) -> Recorder:
    """Record, every `period` (s), the signals `position` and `velocity` of the robot, n each.

    With bodies that move, also `plant_position`, the positions of all, for a replay.
    """
    recorder, n = Recorder(builder, period), cell.robot.n
    recorder.add("position", cell.robot_state, _unit(cell, "rad", "m"), lambda x: x[:n])
    recorder.add("velocity", cell.robot_state, _unit(cell, "rad/s", "m/s"), lambda x: x[n:])
    count = cell.plant.num_positions()
    if count > n:
        recorder.add("plant_position", cell.plant.get_state_output_port(), "mixed", lambda x: x[:count])
    return recorder


def record_limits(builder: DiagramBuilder, cell: Cell, torque_excess: OutputPort) -> Recorder:
    """Record what `limit_metrics` takes, at every step of the plant: `velocity` and `torque_excess`, n each."""
    recorder, n = Recorder(builder, cell.params.time_step), cell.robot.n
    recorder.add("velocity", cell.robot_state, _unit(cell, "rad/s", "m/s"), lambda x: x[n:])
    recorder.add("torque_excess", torque_excess, _unit(cell, "Nm", "N"))
    return recorder


def _unit(cell: Cell, revolute: str, prismatic: str) -> str:
    return revolute if np.all(cell.robot.tree.kind == REVOLUTE) else f"{revolute}, {prismatic}"
