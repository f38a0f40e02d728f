"""The cell of Section 6: a robot with a sensitive skin and a wrist sensor, led by two hands, as one diagram."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort

from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.hand_guiding.system import HandGuidingController
from saphari_drake.errors import ParameterError
from saphari_drake.estimation.joint_acceleration import JointAcceleration
from saphari_drake.parameters import require_choice, require_positive
from saphari_drake.perception.skin.calibration import SkinCalibration, calibrate
from saphari_drake.perception.skin.estimator import SkinEstimator, SkinEstimatorParameters
from saphari_drake.perception.skin.layout import SkinLayout, SkinLayoutParameters
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.guiding_hands import Grip, GuidingHands
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensor, ForceTorqueSensorParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.sensors.skin_indenter import indent
from saphari_drake.simulation.sensors.skin_modules import SkinModules
from saphari_drake.simulation.sensors.skin_sensor import SkinSensor, SkinSensorParameters
from saphari_drake.simulation.world.cell import connect_torque, ignore_self_contact
from saphari_drake.simulation.world.hand_and_floor import add_floor
from saphari_drake.simulation.world.position_servo import JointPositionServo, PositionServoParameters

Array = NDArray[np.float64]
PERIOD = 0.002  # s, the control cycle
INTERFACES = ("torque", "position")


@dataclass
class GuidingCellParameters:
    """World, sensors and controller; the cycles must be equal."""

    # s; step of the discrete plant.
    time_step: float = 0.001
    # What the arm takes: torque, or position, to which its own stiff servo then holds.
    interface: str = "torque"
    servo: PositionServoParameters = field(default_factory=lambda: PositionServoParameters(period=PERIOD))
    # The arm reports position with its own velocity; the steps are those of a fine encoder. A.
    joint_sensor: JointSensorParameters = field(default_factory=lambda: JointSensorParameters(PERIOD, 1e-6))
    skin_layout: SkinLayoutParameters = field(default_factory=SkinLayoutParameters)
    skin_sensor: SkinSensorParameters = field(default_factory=lambda: SkinSensorParameters(period=PERIOD))
    skin_estimator: SkinEstimatorParameters = field(default_factory=lambda: SkinEstimatorParameters(period=PERIOD))
    # The tip is where the hand holds a light handle at the flange.
    force_sensor: ForceTorqueSensorParameters = field(
        default_factory=lambda: ForceTorqueSensorParameters(tip_point=[0.0, 0.0, 0.12], period=PERIOD)
    )
    controller: HandGuidingParameters = field(default_factory=lambda: HandGuidingParameters(period=PERIOD))

    def __post_init__(self) -> None:
        require_positive(self, "time_step")
        require_choice(self, "interface", INTERFACES)
        for name in ("servo", "skin_sensor", "skin_estimator", "force_sensor", "controller"):
            if getattr(self, name).period != self.joint_sensor.period:
                raise ParameterError(f"{name}.period", f"must equal joint_sensor.period, {self.joint_sensor.period} s")


@dataclass
class GuidingCell:
    """What `add_guiding_cell` put into a diagram."""

    robot: RobotModel
    plant: MultibodyPlant
    scene_graph: SceneGraph
    instance: ModelInstanceIndex
    robot_state: OutputPort
    layout: SkinLayout
    hands: GuidingHands
    controller: HandGuidingController
    skin: SkinEstimator
    force_sensor: ForceTorqueSensor
    torque_excess: OutputPort  # of the system that drives the joints


def add_guided_robot(
    builder: DiagramBuilder, robot: RobotModel, params: GuidingCellParameters
) -> tuple[MultibodyPlant, SceneGraph, ModelInstanceIndex, InputPort]:
    """Add the plant with the robot at its home posture; return it, with the input of its joint torques."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, params.time_step)
    plant.set_name("plant")
    instance = robot.add_to(plant)
    add_floor(plant)
    plant.Finalize()
    plant.SetDefaultPositions(instance, robot.home)
    ignore_self_contact(plant, scene_graph, instance)
    return plant, scene_graph, instance, connect_torque(builder, robot, plant, instance)


def skin_calibration(layout: SkinLayout, params: GuidingCellParameters) -> SkinCalibration:
    """Return the calibration of the cell's skin from presses of an indenter."""
    return calibrate(layout, indent(SkinModules(layout, params.skin_sensor.modules)))


def add_guiding_cell(
    builder: DiagramBuilder,
    robot: RobotModel,
    grips: Sequence[Grip],
    params: GuidingCellParameters,
    layout: SkinLayout,
    calibration: SkinCalibration,
) -> GuidingCell:
    """Add the whole cell: plant, hands, sensors and controller, which knows nothing but the sensors."""

    def add(name: str, system: LeafSystem):
        return builder.AddNamedSystem(name, system)

    plant, scene_graph, instance, torque_input = add_guided_robot(builder, robot, params)
    hands = add("hands", GuidingHands(robot, plant, instance, grips, params.time_step))
    joints = add("joint_sensor", JointSensor(robot, params.joint_sensor))
    dynamics = add("dynamics", RobotDynamics(robot))
    sensor = add("skin_sensor", SkinSensor(layout, robot, plant, instance, params.skin_sensor))
    skin = add("skin_estimator", SkinEstimator(layout, calibration, params.skin_estimator))
    wrist = add("force_sensor", ForceTorqueSensor(robot, plant, instance, params.force_sensor))
    acceleration = add("joint_acceleration", JointAcceleration(robot, params.joint_sensor.period))
    controller = add("controller", HandGuidingController(robot, params.controller))
    state = plant.get_state_output_port(instance)
    forces = hands.GetOutputPort("applied_forces")
    builder.Connect(forces, plant.get_applied_spatial_force_input_port())
    builder.Connect(forces, sensor.GetInputPort("applied_forces"))
    builder.Connect(plant.get_reaction_forces_output_port(), wrist.GetInputPort("reaction_forces"))
    for system in (hands, joints, sensor):
        builder.Connect(state, system.GetInputPort("state"))
    wires = (
        (joints, "position_measured", dynamics, "position_measured"),
        (joints, "velocity_measured", dynamics, "velocity_measured"),
        (dynamics, "dynamics", wrist, "dynamics"),
        # Without it, the feedforward of the measured force would answer what it does to the tool itself.
        (joints, "velocity_measured", acceleration, "velocity_measured"),
        (acceleration, "acceleration_measured", wrist, "acceleration_measured"),
        (dynamics, "dynamics", controller, "dynamics"),
        (sensor, "voltages", skin, "voltages"),
        (sensor, "sample_time", skin, "sample_time"),
        (skin, "skin_reading", controller, "skin"),
        (wrist, "wrench_measured", controller, "wrench_measured"),
    )
    for source, output, target, target_port in wires:
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(target_port))
    driving = controller
    if params.interface == "position":
        servo = driving = add("position_servo", JointPositionServo(robot, params.servo))
        builder.Connect(state, servo.GetInputPort("state"))
        builder.Connect(controller.GetOutputPort("position_commanded"), servo.GetInputPort("position_commanded"))
    builder.Connect(driving.GetOutputPort("torque_commanded"), torque_input)
    excess = driving.GetOutputPort("torque_excess")
    return GuidingCell(robot, plant, scene_graph, instance, state, layout, hands, controller, skin, wrist, excess)
