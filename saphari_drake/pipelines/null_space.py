"""From the measured joint state to a torque that keeps the task: the systems of Section 5, wired."""

from dataclasses import dataclass, field
from typing import NamedTuple

from pydrake.systems.framework import DiagramBuilder, OutputPort

from saphari_drake.control.null_space.parameters import NullSpaceComplianceParameters
from saphari_drake.control.null_space.system import NullSpaceComplianceController
from saphari_drake.estimation.disturbance_observer import DisturbanceObserver, DisturbanceObserverParameters
from saphari_drake.estimation.joint_velocity import JointVelocityParameters
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters
from saphari_drake.parameters import require_positive, share_period
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
from saphari_drake.systems import connect


@dataclass
class NullSpacePipelineParameters:
    """Parameters of all systems between sensors and torque."""

    # s; the control cycle of all parts, which take it from here. That of the deliverable.
    period: float = 0.002
    check: JointCheckParameters = field(default_factory=JointCheckParameters)
    # Also without the observer momentum: for the threshold, and to be compared.
    momentum: MomentumObserverParameters = field(default_factory=MomentumObserverParameters)
    disturbance: DisturbanceObserverParameters = field(default_factory=DisturbanceObserverParameters)
    controller: NullSpaceComplianceParameters = field(default_factory=NullSpaceComplianceParameters)
    switch: CommandSwitchParameters = field(default_factory=CommandSwitchParameters)
    envelope: JointEnvelopeParameters = field(default_factory=JointEnvelopeParameters)
    # Of coarse encoders; with `resolution` 0 the measured velocity is taken as it is. A touch is felt through the
    # velocity alone, hence with little lag.
    velocity: JointVelocityParameters = field(default_factory=lambda: JointVelocityParameters(unknown_torque=1.0))

    def __post_init__(self) -> None:
        require_positive(self, "period")
        share_period(self, "check", "momentum", "disturbance", "controller", "switch", "velocity")


class NullSpacePipeline(NamedTuple):
    """The systems that others look at."""

    dynamics: RobotDynamics
    momentum: MomentumObserver
    disturbance: DisturbanceObserver
    controller: NullSpaceComplianceController
    switch: CommandSwitch
    envelope: JointEnvelope

    @property
    def torque_output(self) -> OutputPort:
        """Joint torque, n (Nm)."""
        return self.envelope.GetOutputPort("torque_applied")


def add_null_space_pipeline(
    builder: DiagramBuilder,
    robot: RobotModel,
    position: OutputPort,
    velocity: OutputPort,
    params: NullSpacePipelineParameters | None = None,
    joint_state: JointState | None = None,
    witness: JointWitness | None = None,
) -> NullSpacePipeline:
    """Add dynamics, observers, controller, switch and envelope, and connect them to what the joints measure.

    `position` and `velocity` are held over each cycle; `joint_state` is at the robot's own rate, the period of the
    envelope. The desired motion is left to connect to the controller; without it, the pose at the start is kept.
    """
    params = params or NullSpacePipelineParameters()
    params.__post_init__()  # its parts take the period
    add = builder.AddNamedSystem
    checked = add_joint_check(builder, robot, JointState(position, velocity), params.check, witness)
    estimated = add_joint_velocity(builder, robot, checked.state, params.velocity, "joint_velocity")
    switch = add("command_switch", CommandSwitch(robot, params.switch))
    momentum = add("momentum_observer", MomentumObserver(robot, params.momentum))
    torque_external, held = momentum.GetOutputPort("torque_external"), estimated.state
    p = NullSpacePipeline(
        dynamics=add("dynamics", RobotDynamics(robot)),
        momentum=momentum,
        disturbance=add("disturbance_observer", DisturbanceObserver(robot, params.disturbance)),
        controller=add("controller", NullSpaceComplianceController(robot, params.controller)),
        switch=switch,
        envelope=add_joint_envelope(
            builder,
            robot,
            switch,
            torque_external,
            held,
            joint_state,
            params.envelope,
            params.period,
            params.velocity,
        ),
    )
    connect(
        builder,
        (p.dynamics, "dynamics", p.momentum, p.controller, p.switch),
        (p.momentum, "torque_external", p.controller),
        (p.controller, "observer_drive", p.disturbance),
        (p.controller, "yielding", p.disturbance),
        (p.controller, "torque_commanded", p.switch),
        (p.envelope, "torque_excess", p.disturbance),
    )
    for source, target, name in (
        (held.position, p.dynamics, "position_measured"),
        (held.velocity, p.dynamics, "velocity_measured"),
        (p.envelope.GetOutputPort("torque_mean"), p.momentum, "torque_applied"),
        (p.disturbance.GetOutputPort("torque_external"), p.controller, "torque_external_task"),
    ):
        builder.Connect(source, target.GetInputPort(name))
    checked.close(builder, p.envelope.GetOutputPort("torque_acting"), witness)
    estimated.close(builder, p.dynamics, p.envelope.GetOutputPort("torque_mean"))
    return p
