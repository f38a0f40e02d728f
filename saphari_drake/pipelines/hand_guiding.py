"""From measured joints, wrist load and skin voltages to the torque that follows the hands: Section 6, wired."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.hand_guiding.system import HandGuidingController
from saphari_drake.estimation.joint_acceleration import JointAcceleration
from saphari_drake.estimation.joint_velocity import JointVelocityParameters
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters
from saphari_drake.estimation.wrench_check import WrenchCheck, WrenchCheckParameters
from saphari_drake.parameters import require_positive, share_period
from saphari_drake.perception.skin.calibration import SkinCalibration
from saphari_drake.perception.skin.estimator import SkinEstimator, SkinEstimatorParameters
from saphari_drake.perception.skin.layout import SkinLayout
from saphari_drake.perception.wrench.estimator import WristWrenchEstimator, WristWrenchParameters
from saphari_drake.perception.wrench.tool import ToolParameters
from saphari_drake.pipelines.envelope import (
    JointState,
    JointWitness,
    add_joint_check,
    add_joint_envelope,
    add_joint_velocity,
)
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.command_switch import CommandSwitch, CommandSwitchParameters
from saphari_drake.safety.joint_check.parameters import JointCheckParameters
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.safety.joint_envelope.system import JointEnvelope


@dataclass
class HandGuidingPipelineParameters:
    """Estimators, controller and switch."""

    # s; the control cycle of all parts, which take it from here.
    period: float = 0.002
    check: JointCheckParameters = field(default_factory=JointCheckParameters)
    skin: SkinEstimatorParameters = field(default_factory=SkinEstimatorParameters)
    # The guided point of the end effector is the tip of the wrist's wrench: where the hand holds a light handle.
    wrist: WristWrenchParameters = field(default_factory=lambda: WristWrenchParameters(tip_point=[0.0, 0.0, 0.12]))
    # Of the wrist's wrench, by what the joints feel.
    wrench: WrenchCheckParameters = field(default_factory=WrenchCheckParameters)
    controller: HandGuidingParameters = field(default_factory=HandGuidingParameters)
    # The answer to a joint state that is not known, and the way back.
    switch: CommandSwitchParameters = field(default_factory=CommandSwitchParameters)
    # What the hands do to the arm, for the envelope alone.
    observer: MomentumObserverParameters = field(default_factory=MomentumObserverParameters)
    envelope: JointEnvelopeParameters = field(default_factory=JointEnvelopeParameters)
    # Of coarse encoders; with `resolution` 0 the measured velocity is taken as it is.
    velocity: JointVelocityParameters = field(default_factory=JointVelocityParameters)

    def __post_init__(self) -> None:
        require_positive(self, "period")
        share_period(self, "check", "skin", "wrist", "wrench", "controller", "switch", "observer", "velocity")
        for part in (self.controller, self.wrench):
            part.tip_frame, part.tip_point = self.wrist.tip_frame, list(self.wrist.tip_point)
        self.wrench.gain = float(np.mean(self.observer.gain))
        self.controller.__post_init__()


class HandGuidingMeasurements(NamedTuple):
    """Ports that the pipeline is fed from: of simulated sensors, or of a real arm."""

    position: OutputPort  # n (rad or m)
    velocity: OutputPort  # n (rad/s or m/s)
    wrench: OutputPort  # 6 (Nm, N), reading of the wrist sensor
    voltages: OutputPort | None = None  # of the skin (V); none: there is no skin
    sample_time: OutputPort | None = None  # when they were read (s)
    joint_state: JointState | None = None  # at the robot's own rate, the period of the envelope
    witness: JointWitness | None = None


class HandGuidingPipeline(NamedTuple):
    """The systems that others look at."""

    skin: SkinEstimator | None
    wrist: WristWrenchEstimator
    controller: HandGuidingController
    switch: CommandSwitch
    envelope: JointEnvelope

    @property
    def torque_output(self) -> OutputPort:
        """Joint torque, n (Nm or N), for an arm that takes torques."""
        return self.envelope.GetOutputPort("torque_applied")

    @property
    def position_output(self) -> OutputPort:
        """Joint position at the end of the cycle, n (rad or m), for an arm that takes positions."""
        return self.controller.GetOutputPort("position_commanded")


def add_hand_guiding_pipeline(
    builder: DiagramBuilder,
    robot: RobotModel,
    measured: HandGuidingMeasurements,
    layout: SkinLayout | None = None,
    calibration: SkinCalibration | None = None,
    params: HandGuidingPipelineParameters | None = None,
    tool: ToolParameters | None = None,
) -> HandGuidingPipeline:
    """Add dynamics, estimators of skin and wrist, the controller, and what stands behind it, and connect them.

    Without `layout` and `calibration` there is no skin, and the end effector alone is guided. `tool` is what the wrist
    sensor carries, as identified; default: as the model has it.
    """
    params = params or HandGuidingPipelineParameters()
    params.__post_init__()  # its parts take period and tip

    def add(name: str, system: LeafSystem):
        return builder.AddNamedSystem(name, system)

    dynamics = add("dynamics", RobotDynamics(robot))
    joints = JointState(measured.position, measured.velocity)
    checked = add_joint_check(builder, robot, joints, params.check, measured.witness)
    estimated = add_joint_velocity(builder, robot, checked.state, params.velocity, "joint_velocity")
    position, velocity = estimated.state
    if estimated.estimator:
        acceleration = estimated.estimator.GetOutputPort("acceleration_estimated")
    else:
        difference = add("joint_acceleration", JointAcceleration(robot, params.period))
        builder.Connect(velocity, difference.GetInputPort("velocity_measured"))
        acceleration = difference.GetOutputPort("acceleration_measured")
    skin = None
    if layout is not None and calibration is not None:
        skin = add("skin_estimator", SkinEstimator(layout, calibration, params.skin))
    believed = add("wrench_check", WrenchCheck(robot, params.wrench))
    wrist = add("wrist_wrench", WristWrenchEstimator(robot, params.wrist, tool))
    controller = add("controller", HandGuidingController(robot, params.controller))
    switch = add("command_switch", CommandSwitch(robot, params.switch))
    observer = add("momentum_observer", MomentumObserver(robot, params.observer))
    torque_external, held = observer.GetOutputPort("torque_external"), estimated.state
    envelope = add_joint_envelope(
        builder, robot, switch, torque_external, held, measured.joint_state, params.envelope, params.period,
        params.velocity,
    )  # fmt: skip
    estimated.close(builder, dynamics, envelope.GetOutputPort("torque_mean"))
    checked.close(builder, envelope.GetOutputPort("torque_acting"), measured.witness)
    wires: list[tuple[Any, LeafSystem, str]] = [
        (position, dynamics, "position_measured"),
        (velocity, dynamics, "velocity_measured"),
        (measured.wrench, wrist, "wrench_sensor"),
        (dynamics.get_output_port(), wrist, "dynamics"),
        # Without it, the feedforward of the measured force would answer what it does to the tool itself.
        (acceleration, wrist, "acceleration_measured"),
        (dynamics.get_output_port(), controller, "dynamics"),
        (wrist.GetOutputPort("wrench_measured"), believed, "wrench_measured"),
        (dynamics.get_output_port(), believed, "dynamics"),
        (torque_external, believed, "torque_external"),
        (believed.GetOutputPort("wrench_checked"), controller, "wrench_measured"),
        (dynamics.get_output_port(), switch, "dynamics"),
        (controller.GetOutputPort("torque_commanded"), switch, "torque_commanded"),
        (dynamics.get_output_port(), observer, "dynamics"),
        (envelope.GetOutputPort("torque_mean"), observer, "torque_applied"),
    ]
    if skin is not None:
        wires += [
            (measured.voltages, skin, "voltages"),
            (measured.sample_time, skin, "sample_time"),
            (skin.GetOutputPort("skin_reading"), controller, "skin"),
            (skin.GetOutputPort("skin_reading"), believed, "skin"),
        ]
    for source, system, name in wires:
        builder.Connect(source, system.GetInputPort(name))
    return HandGuidingPipeline(skin, wrist, controller, switch, envelope)
