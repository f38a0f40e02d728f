"""The diagram of Section 5: a robot beside an obstacle, its joint sensor, and the null-space pipeline."""

from dataclasses import dataclass, field

from pydrake.systems.framework import DiagramBuilder

from experiments.joint_state import feel_torque, joint_witness, own_joint_state
from saphari_drake.parameters import require_choice, share_period
from saphari_drake.pipelines.null_space import (
    NullSpacePipeline,
    NullSpacePipelineParameters,
    add_null_space_pipeline,
)
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import Body, Cell, add_cell
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.obstacles import Ball, BallParameters, Wall, WallParameters
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.simulation.world.profile import Truth


@dataclass
class ObstacleCellParameters(PlantParameters):
    """An arm with a rigid cover, and what is beside it."""

    rigid_cover: bool = True
    # What is beside the arm: ball, wall or nothing.
    obstacle: str = "ball"
    ball: BallParameters = field(default_factory=BallParameters)
    wall: WallParameters = field(default_factory=WallParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "obstacle", ("ball", "wall", "nothing"))

    @property
    def bodies(self) -> list[Body]:
        """The floor and the obstacle."""
        obstacles: dict[str, list[Body]] = {"ball": [Ball(self.ball)], "wall": [Wall(self.wall)], "nothing": []}
        return [Floor(), *obstacles[self.obstacle]]


@dataclass
class NullSpaceCellParameters(NullSpacePipelineParameters):
    """World, sensor and pipeline."""

    cell: ObstacleCellParameters = field(default_factory=ObstacleCellParameters)
    # The arm reports position with its own velocity; the steps are those of a fine encoder. Assumed.
    joint_sensor: JointSensorParameters = field(
        default_factory=lambda: JointSensorParameters(position_resolution=1e-6, differentiate=True)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        share_period(self, "joint_sensor")


@dataclass
class NullSpaceCell:
    """The parts of the diagram that others look at."""

    cell: Cell
    pipeline: NullSpacePipeline


def add_null_space_cell(
    builder: DiagramBuilder,
    robot: RobotModel,
    params: NullSpaceCellParameters | None = None,
    truth: Truth | None = None,
) -> NullSpaceCell:
    """Add the whole cell; the robot starts at its home posture."""
    params, truth = params or NullSpaceCellParameters(), truth or Truth()
    cell = add_cell(builder, robot, params.cell.bodies, params.cell, truth)
    params.__post_init__()  # the sensor takes the period
    sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, truth.joint_sensor(params.joint_sensor)))
    builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
    state = own_joint_state(
        builder, robot, cell, params.joint_sensor, params.envelope, params.momentum, truth, params.velocity
    )
    ports = sensor.get_output_port(0), sensor.get_output_port(1)
    witness = joint_witness(builder, robot, cell, params.joint_sensor, truth)
    pipeline = add_null_space_pipeline(builder, robot, *ports, params, state, witness)
    builder.Connect(pipeline.torque_output, cell.torque_input)
    feel_torque(builder, cell, pipeline.torque_output)
    return NullSpaceCell(cell, pipeline)
