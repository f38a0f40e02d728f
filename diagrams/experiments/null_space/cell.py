"""The diagram of Section 5: a robot beside an obstacle, its joint sensor, and the null-space pipeline."""

from dataclasses import dataclass, field

from pydrake.systems.framework import DiagramBuilder

from saphari_drake.parameters import share_period
from saphari_drake.pipelines.null_space import (
    NullSpacePipeline,
    NullSpacePipelineParameters,
    add_null_space_pipeline,
)
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.obstacle_cell import ObstacleCell, ObstacleCellParameters, add_obstacle_cell


@dataclass
class NullSpaceCellParameters(NullSpacePipelineParameters):
    """World, sensor and pipeline."""

    cell: ObstacleCellParameters = field(default_factory=ObstacleCellParameters)
    # The arm reports position with its own velocity; the steps are those of a fine encoder. A.
    joint_sensor: JointSensorParameters = field(
        default_factory=lambda: JointSensorParameters(position_resolution=1e-6, differentiate=True)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        share_period(self, "joint_sensor")


@dataclass
class NullSpaceCell:
    """The parts of the diagram that others look at."""

    cell: ObstacleCell
    pipeline: NullSpacePipeline


def add_null_space_cell(
    builder: DiagramBuilder, robot: RobotModel, params: NullSpaceCellParameters | None = None
) -> NullSpaceCell:
    """Add the whole cell; the robot starts at its home posture."""
    params = params or NullSpaceCellParameters()
    cell = add_obstacle_cell(builder, robot, params.cell)
    params.__post_init__()  # the sensor takes the period
    sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, params.joint_sensor))
    builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
    pipeline = add_null_space_pipeline(builder, robot, sensor.get_output_port(0), sensor.get_output_port(1), params)
    builder.Connect(pipeline.torque_output, cell.torque_input)
    return NullSpaceCell(cell, pipeline)
