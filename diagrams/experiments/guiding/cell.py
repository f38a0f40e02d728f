"""The cell of Section 6: a robot with a sensitive skin and a wrist sensor, led by two hands, as one diagram."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from experiments.guiding.tool import identified_tool
from experiments.joint_state import feel_torque, joint_witness, own_joint_state
from saphari_drake.parameters import require_choice
from saphari_drake.perception.skin.calibration import SkinCalibration, calibrate
from saphari_drake.perception.skin.layout import SkinLayout, SkinLayoutParameters
from saphari_drake.pipelines.hand_guiding import (
    HandGuidingMeasurements,
    HandGuidingPipeline,
    HandGuidingPipelineParameters,
    add_hand_guiding_pipeline,
)
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.guiding_hands import Grip, GuidingHands
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensor, ForceTorqueSensorParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.sensors.skin_indenter import indent
from saphari_drake.simulation.sensors.skin_modules import SkinModules
from saphari_drake.simulation.sensors.skin_sensor import SkinSensor, SkinSensorParameters
from saphari_drake.simulation.world.cell import Cell, add_cell
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.simulation.world.position_servo import JointPositionServo, PositionServoParameters
from saphari_drake.simulation.world.profile import Truth

INTERFACES = ("torque", "position")


@dataclass
class GuidingCellParameters(PlantParameters):
    """World, sensors and pipeline, whose period all take, and the wrist sensor its joint, whatever theirs were."""

    # What the arm takes: torque, or position, to which its own stiff servo then holds.
    interface: str = "torque"
    servo: PositionServoParameters = field(default_factory=PositionServoParameters)
    # The arm reports position with its own velocity; the steps are those of a fine encoder. Assumed.
    joint_sensor: JointSensorParameters = field(default_factory=lambda: JointSensorParameters(position_resolution=1e-6))
    skin_layout: SkinLayoutParameters = field(default_factory=SkinLayoutParameters)
    skin_sensor: SkinSensorParameters = field(default_factory=SkinSensorParameters)
    force_sensor: ForceTorqueSensorParameters = field(default_factory=ForceTorqueSensorParameters)
    pipeline: HandGuidingPipelineParameters = field(default_factory=HandGuidingPipelineParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "interface", INTERFACES)
        for part in (self.servo, self.joint_sensor, self.skin_sensor, self.force_sensor):
            part.period = self.pipeline.period
        self.force_sensor.joint = self.pipeline.wrist.joint


@dataclass
class GuidingCell:
    """What `add_guiding_cell` put into a diagram."""

    cell: Cell
    hands: GuidingHands
    pipeline: HandGuidingPipeline
    torque_excess: OutputPort  # of the system that drives the joints


def skin_calibration(layout: SkinLayout, params: GuidingCellParameters) -> SkinCalibration:
    """Return the calibration of the cell's skin from presses of an indenter."""
    return calibrate(layout, indent(SkinModules(layout, params.skin_sensor.modules)))


def add_guiding_cell(
    builder: DiagramBuilder,
    robot: RobotModel,
    grips: Sequence[Grip],
    params: GuidingCellParameters,
    layout: SkinLayout,
    truth: Truth | None = None,
) -> GuidingCell:
    """Add the whole cell: plant, hands, sensors and the pipeline, which knows nothing but the sensors."""
    params, truth = replace(params), truth or Truth()  # sensors and servo take the period

    def add(name: str, system: LeafSystem):
        return builder.AddNamedSystem(name, system)

    cell = add_cell(builder, robot, [Floor()], params, truth)
    plant, instance, state = cell.plant, cell.instance, cell.robot_state
    hands = add("hands", GuidingHands(robot, plant, instance, grips, params.time_step))
    joints = add("joint_sensor", JointSensor(robot, truth.joint_sensor(params.joint_sensor)))
    skin = add("skin_sensor", SkinSensor(layout, robot, plant, instance, params.skin_sensor))
    wrist = add("force_sensor", ForceTorqueSensor(plant, instance, params.force_sensor))
    forces = hands.GetOutputPort("applied_forces")
    builder.Connect(forces, plant.get_applied_spatial_force_input_port())
    builder.Connect(forces, skin.GetInputPort("applied_forces"))
    builder.Connect(plant.get_reaction_forces_output_port(), wrist.GetInputPort("reaction_forces"))
    for system in (hands, joints, skin):
        builder.Connect(state, system.GetInputPort("state"))
    witness = joint_witness(builder, robot, cell, params.joint_sensor, truth)
    if params.interface == "position":  # whose servo does not tell what it asks for
        witness = witness._replace(torque=None)
    measured = HandGuidingMeasurements(
        joints.GetOutputPort("position_measured"),
        joints.GetOutputPort("velocity_measured"),
        wrist.GetOutputPort("wrench_sensor"),
        skin.GetOutputPort("voltages"),
        skin.GetOutputPort("sample_time"),
        own_joint_state(
            builder,
            robot,
            cell,
            params.joint_sensor,
            params.pipeline.envelope,
            params.pipeline.observer,
            truth,
            params.pipeline.velocity,
        ),
        witness,
    )
    calibration = skin_calibration(layout, params)
    tool = identified_tool(robot, truth, params.force_sensor)
    pipeline = add_hand_guiding_pipeline(builder, robot, measured, layout, calibration, params.pipeline, tool)
    driving, torque = pipeline.envelope, pipeline.torque_output
    if params.interface == "position":
        driving = add("position_servo", JointPositionServo(robot, params.servo))
        builder.Connect(state, driving.GetInputPort("state"))
        builder.Connect(pipeline.position_output, driving.GetInputPort("position_commanded"))
        torque = driving.GetOutputPort("torque_commanded")
    builder.Connect(torque, cell.torque_input)
    feel_torque(builder, cell, torque)
    excess = driving.GetOutputPort("torque_excess")
    return GuidingCell(cell, hands, pipeline, excess)
