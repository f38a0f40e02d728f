"""The last element of each torque pipeline: the joint envelope, at the robot's own rate."""

from dataclasses import replace
from typing import NamedTuple

from pydrake.systems.framework import DiagramBuilder, OutputPort

from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.command_switch import CommandSwitch
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters
from saphari_drake.safety.joint_envelope.system import JointEnvelope
from saphari_drake.systems import connect


class JointState(NamedTuple):
    """Ports of a measured joint state."""

    position: OutputPort  # n (rad or m)
    velocity: OutputPort  # n (rad/s or m/s)


def add_joint_envelope(
    builder: DiagramBuilder,
    robot: RobotModel,
    switch: CommandSwitch,
    torque_external: OutputPort,
    held: JointState,
    own: JointState | None,
    params: JointEnvelopeParameters,
    period: float,
) -> JointEnvelope:
    """Add an envelope behind a switch, with dynamics of its own; its `torque_mean` is over `period`.

    Without a joint state at its own rate it takes the one that is held over `period`, and acts as often: bounds on
    what happens between are then coarser.
    """
    if own is None:
        params = replace(params, period=period, velocity_age=0.5 * period, mean_time=period)
    else:
        params = replace(params, mean_time=period)
    state = own or held
    dynamics = builder.AddNamedSystem("envelope_dynamics", RobotDynamics(robot))
    envelope = builder.AddNamedSystem("joint_envelope", JointEnvelope(robot, params))
    builder.Connect(state.position, dynamics.GetInputPort("position_measured"))
    builder.Connect(state.velocity, dynamics.GetInputPort("velocity_measured"))
    builder.Connect(torque_external, envelope.GetInputPort("torque_external"))
    connect(
        builder,
        (dynamics, "dynamics", envelope),
        (switch, "torque_commanded", envelope),
        (envelope, "torque_applied", switch),
    )
    return envelope
