"""From the ports of a station to its torque: the three ways of control that need no camera and no skin."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import ConstantValueSource

from experiments.hardware.declared import DeclaredContact, add_tip_force
from saphari_drake.control.contact.parameters import ContactImpedanceParameters
from saphari_drake.control.contact.system import ContactImpedanceController
from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.hand_guiding.system import HandGuidingController
from saphari_drake.estimation.contact_force import ContactForceEstimator, ContactForceParameters
from saphari_drake.estimation.joint_velocity import JointVelocityParameters
from saphari_drake.estimation.model_error import ModelErrorEstimator, ModelErrorParameters
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters
from saphari_drake.messages import SkinReading
from saphari_drake.parameters import share_period
from saphari_drake.pipelines.envelope import JointState, add_joint_envelope, add_joint_velocity
from saphari_drake.pipelines.null_space import NullSpacePipelineParameters, add_null_space_pipeline
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.command_switch import CommandSwitch, CommandSwitchParameters
from saphari_drake.safety.contact_detector import ContactDetector, ContactDetectorParameters
from saphari_drake.safety.contact_monitor import ContactMonitor, ContactMonitorParameters
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.stations.ports import StationPorts
from saphari_drake.systems import connect


@dataclass
class TouchParameters:
    """Systems that answer a touch at a declared point, or a hand at the tip; they take the period from here."""

    # s; the control cycle: that of the deliverable's contact experiments.
    period: float = 0.005
    observer: MomentumObserverParameters = field(default_factory=MomentumObserverParameters)
    # No camera sees who holds the arm: what it feels on its way is not taken for friction.
    model_error: ModelErrorParameters = field(default_factory=lambda: ModelErrorParameters(offset_way=0.0, viscous=0.0))
    detector: ContactDetectorParameters = field(default_factory=ContactDetectorParameters)
    force: ContactForceParameters = field(default_factory=ContactForceParameters)
    monitor: ContactMonitorParameters = field(default_factory=ContactMonitorParameters)
    controller: ContactImpedanceParameters = field(default_factory=ContactImpedanceParameters)
    guiding: HandGuidingParameters = field(default_factory=HandGuidingParameters)
    switch: CommandSwitchParameters = field(default_factory=CommandSwitchParameters)
    envelope: JointEnvelopeParameters = field(default_factory=JointEnvelopeParameters)
    # Of coarse encoders, for hand guiding; with `resolution` 0 the measured velocity is taken as it is.
    velocity: JointVelocityParameters = field(default_factory=JointVelocityParameters)

    def __post_init__(self) -> None:
        share_period(
            self, "observer", "model_error", "detector", "monitor", "controller", "guiding", "switch", "velocity"
        )


class Driven(NamedTuple):
    """What drives the robot, and ports that tell about it: name, unit, port."""

    torque: OutputPort
    told: tuple[tuple[str, str, OutputPort], ...]


def add_contact_impedance(
    builder: DiagramBuilder,
    robot: RobotModel,
    station: StationPorts,
    params: TouchParameters,
    link: str,
    p_L: list[float],
) -> Driven:
    """Add the pipeline of a contact whose place is declared: that of Section 7 without its camera."""
    params.__post_init__()
    add, n = builder.AddNamedSystem, robot.n
    dynamics = add("dynamics", RobotDynamics(robot))
    switch = add("command_switch", CommandSwitch(robot, params.switch))
    observer = add("momentum_observer", MomentumObserver(robot, params.observer))
    bandwidth = list(params.observer.bandwidth * np.ones(n))
    learned = add("model_error", ModelErrorEstimator(robot, params.model_error, bandwidth))
    detector = add("contact_detector", ContactDetector(n, params.detector))
    declared = add("declared_contact", DeclaredContact(robot, link, p_L))
    monitor = add("contact_monitor", ContactMonitor(robot, params.monitor))
    force = add("contact_force", ContactForceEstimator(robot, params.force))
    controller = add("controller", ContactImpedanceController(robot, params.controller))
    held, external = JointState(station.position_measured, station.velocity_measured), observer.GetOutputPort
    envelope = add_joint_envelope(
        builder, robot, switch, external("torque_external"), held, None, params.envelope, params.period
    )
    for source, target, name in (
        (held.position, dynamics, "position_measured"),
        (held.velocity, dynamics, "velocity_measured"),
        (monitor.GetOutputPort("active_contact"), force, "contact_point"),
        (envelope.GetOutputPort("torque_mean"), observer, "torque_applied"),
    ):
        builder.Connect(source, target.GetInputPort(name))
    connect(
        builder,
        (dynamics, "dynamics", observer, learned),
        (observer, "torque_external", learned),
        (observer, "friction_uncertainty", force),
        (observer, "friction_torque", controller),
        (learned, "dynamics", monitor, force, controller, switch),
        (learned, "torque_external", detector, force),
        (learned, "torque_uncertainty", detector),
        (learned, "torque_noise", detector),
        (detector, "contact", learned, monitor),
        (declared, "contact_point", monitor),
        (declared, "camera_status", monitor),
        (monitor, "interaction", controller),
        (force, "contact_force", controller),
        (force, "misfit", controller),
        (controller, "selection", switch),
        (controller, "torque_commanded", switch),
    )
    told = (
        ("residual", "Nm", learned.GetOutputPort("torque_external")),
        ("contact", "1", detector.GetOutputPort("contact")),
        ("contact_force", "N", force.GetOutputPort("contact_force")),
        ("position_error", "m", controller.GetOutputPort("position_error")),
        ("envelope", "1", envelope.GetOutputPort("status")),
    )
    return Driven(envelope.GetOutputPort("torque_applied"), told)


def add_null_space(
    builder: DiagramBuilder, robot: RobotModel, station: StationPorts, params: NullSpacePipelineParameters
) -> Driven:
    """Add the pipeline of Section 5; the end effector is to stay."""
    p = add_null_space_pipeline(builder, robot, station.position_measured, station.velocity_measured, params)
    told = (
        ("residual", "Nm", p.momentum.GetOutputPort("torque_external")),
        ("task_error", "m", p.controller.GetOutputPort("task_error")),
        ("yielding", "1", p.controller.GetOutputPort("yielding")),
        ("envelope", "1", p.envelope.GetOutputPort("status")),
    )
    return Driven(p.torque_output, told)


def add_hand_guiding(
    builder: DiagramBuilder, robot: RobotModel, station: StationPorts, params: TouchParameters
) -> Driven:
    """Add hand guiding at the tip, whose force comes out of the residual: an arm without wrist sensor and skin."""
    params.__post_init__()
    add, guiding = builder.AddNamedSystem, params.guiding
    measured = JointState(station.position_measured, station.velocity_measured)
    estimated = add_joint_velocity(builder, robot, measured, params.velocity, "joint_velocity")
    dynamics = add("dynamics", RobotDynamics(robot))
    switch = add("command_switch", CommandSwitch(robot, params.switch))
    observer = add("momentum_observer", MomentumObserver(robot, params.observer))
    bandwidth = list(params.observer.bandwidth * np.ones(robot.n))
    learned = add("model_error", ModelErrorEstimator(robot, params.model_error, bandwidth))
    detector = add("contact_detector", ContactDetector(robot.n, params.detector))
    controller = add("controller", HandGuidingController(robot, guiding))
    skin: LeafSystem = add("no_skin", ConstantValueSource(AbstractValue.Make(SkinReading(stamp=np.inf))))
    tip = add_tip_force(builder, robot, guiding.tip_frame or robot.link_names[-1], guiding.tip_point)
    envelope = add_joint_envelope(
        builder, robot, switch, observer.GetOutputPort("torque_external"), estimated.state, None, params.envelope,
        params.period,
    )  # fmt: skip
    estimated.close(builder, dynamics, envelope.GetOutputPort("torque_mean"))
    for source, target, name in (
        (estimated.state.position, dynamics, "position_measured"),
        (estimated.state.velocity, dynamics, "velocity_measured"),
        (envelope.GetOutputPort("torque_mean"), observer, "torque_applied"),
        (tip.wrench, controller, "wrench_measured"),
        (skin.get_output_port(), controller, "skin"),
    ):
        builder.Connect(source, target.GetInputPort(name))
    connect(
        builder,
        (dynamics, "dynamics", observer, learned),
        (observer, "torque_external", learned),
        (observer, "friction_uncertainty", tip.estimator),
        (learned, "dynamics", tip.estimator, controller, switch),
        (learned, "torque_external", detector, tip.estimator),
        (learned, "torque_uncertainty", detector),
        (learned, "torque_noise", detector),
        (detector, "contact", learned),
        (controller, "torque_commanded", switch),
    )
    told = (
        ("residual", "Nm", learned.GetOutputPort("torque_external")),
        ("force", "N", controller.GetOutputPort("force")),
        ("velocity_desired", "m/s", controller.GetOutputPort("velocity_desired")),
        ("guiding_status", "1", controller.GetOutputPort("status")),
        ("envelope", "1", envelope.GetOutputPort("status")),
    )
    return Driven(envelope.GetOutputPort("torque_applied"), told)
