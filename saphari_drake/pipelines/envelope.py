"""First and last element of each torque pipeline: the check of the joint state, and the joint envelope."""

from dataclasses import replace
from typing import NamedTuple

from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from saphari_drake.estimation.joint_velocity import JointVelocity, JointVelocityParameters
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.command_switch import CommandSwitch
from saphari_drake.safety.joint_check.parameters import JointCheckParameters
from saphari_drake.safety.joint_check.system import JointCheck
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.safety.joint_envelope.system import JointEnvelope
from saphari_drake.systems import connect


class JointState(NamedTuple):
    """Ports of a measured joint state."""

    position: OutputPort  # n (rad or m)
    velocity: OutputPort  # n (rad/s or m/s)


class JointWitness(NamedTuple):
    """Ports of sensors that tell of the joints what their encoders and drives cannot prove themselves."""

    position: OutputPort | None = None  # n (rad or m), of second encoders, at the motors
    torque: OutputPort | None = None  # n (Nm or N), of torque sensors in the joints


class CheckedState(NamedTuple):
    """A joint state behind a check, and the check."""

    state: JointState
    check: JointCheck

    def close(self, builder: DiagramBuilder, torque: OutputPort, witness: JointWitness | None) -> None:
        """Tell the check what the drives are to give; without a torque sensor it needs none."""
        if witness and witness.torque:
            builder.Connect(witness.torque, self.check.GetInputPort("torque_measured"))
            builder.Connect(torque, self.check.GetInputPort("torque_expected"))


def add_joint_check(
    builder: DiagramBuilder,
    robot: RobotModel,
    measured: JointState,
    params: JointCheckParameters,
    witness: JointWitness | None,
    name: str = "joint_check",
) -> CheckedState:
    """Add a check of a measured joint state, by another witness if there is one."""
    check = builder.AddNamedSystem(name, JointCheck(robot, params))
    builder.Connect(measured.position, check.GetInputPort("position_measured"))
    builder.Connect(measured.velocity, check.GetInputPort("velocity_measured"))
    if witness and witness.position:
        builder.Connect(witness.position, check.GetInputPort("position_second"))
    return CheckedState(JointState(*(check.GetOutputPort(f"{name}_checked") for name in JointState._fields)), check)


class EstimatedState(NamedTuple):
    """A joint state as the pipeline's parts take it, with the estimator behind it."""

    state: JointState
    estimator: JointVelocity | None  # none: the state is the measured one

    def feed(self, builder: DiagramBuilder, system: LeafSystem) -> None:
        """Give the state to a system."""
        for name, port in zip(("position_measured", "velocity_measured"), self.state):
            builder.Connect(port, system.GetInputPort(name))

    def close(self, builder: DiagramBuilder, dynamics: RobotDynamics, torque: OutputPort) -> None:
        """Tell the estimator, if there is one, dynamics and torque."""
        if self.estimator:
            builder.Connect(dynamics.get_output_port(), self.estimator.GetInputPort("dynamics"))
            builder.Connect(torque, self.estimator.GetInputPort("torque_applied"))


def add_joint_velocity(
    builder: DiagramBuilder, robot: RobotModel, measured: JointState, params: JointVelocityParameters, name: str
) -> EstimatedState:
    """Add an estimator of the joint state; with `resolution` 0, none."""
    if params.resolution == 0.0:
        return EstimatedState(measured, None)
    estimator = builder.AddNamedSystem(name, JointVelocity(robot, params))
    builder.Connect(measured.position, estimator.GetInputPort("position_measured"))
    builder.Connect(measured.velocity, estimator.GetInputPort("velocity_measured"))
    ports = (estimator.GetOutputPort(f"{quantity}_estimated") for quantity in ("position", "velocity"))
    return EstimatedState(JointState(*ports), estimator)


def add_joint_envelope(
    builder: DiagramBuilder,
    robot: RobotModel,
    switch: CommandSwitch,
    torque_external: OutputPort,
    held: JointState,
    own: JointState | None,
    params: JointEnvelopeParameters,
    period: float,
    velocity: JointVelocityParameters | None = None,
) -> JointEnvelope:
    """Add an envelope behind a switch; its `torque_mean` is over `period`.

    Without a joint state at its own rate it takes the one that is held over `period`, and acts as often: bounds on
    what happens between are then coarser. With `velocity`, its own joint state is estimated behind coarse encoders.
    """
    if own is None:
        params = replace(params, period=period, velocity_age=0.5 * period, mean_time=period)
    else:
        params = replace(params, mean_time=period)
    smoothing = JointVelocityParameters()
    if own and velocity:
        smoothing = replace(velocity, period=params.period, unknown_torque=velocity.envelope_torque)
    estimated = add_joint_velocity(builder, robot, own or held, smoothing, "envelope_velocity")
    envelope = builder.AddNamedSystem("joint_envelope", JointEnvelope(robot, params))
    estimated.feed(builder, envelope)
    builder.Connect(torque_external, envelope.GetInputPort("torque_external"))
    connect(builder, (switch, "torque_commanded", envelope), (envelope, "torque_applied", switch))
    if estimated.estimator:
        dynamics = builder.AddNamedSystem("envelope_dynamics", RobotDynamics(robot))
        estimated.feed(builder, dynamics)
        estimated.close(builder, dynamics, envelope.GetOutputPort("torque_acting"))
    return envelope
