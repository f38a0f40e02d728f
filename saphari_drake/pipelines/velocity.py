"""From a commanded joint velocity to a torque: envelope, verified stop and servo, wired."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort

from saphari_drake.control.joint_servo import JointServoParameters, JointVelocityServo
from saphari_drake.pipelines.envelope import JointState
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.torque_limit import TorqueLimit
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters
from saphari_drake.safety.velocity_envelope.system import VelocityEnvelope
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters
from saphari_drake.safety.verified_stop.system import VerifiedStop
from saphari_drake.systems import connect


@dataclass
class VelocityPipelineParameters:
    """Parameters of all systems between command and torque."""

    envelope: VelocityEnvelopeParameters = field(default_factory=VelocityEnvelopeParameters)
    # Its motion is that of the envelope.
    stop: VerifiedStopParameters = field(default_factory=VerifiedStopParameters)
    servo: JointServoParameters = field(default_factory=JointServoParameters)


class VelocityPipeline(NamedTuple):
    """The systems that others look at."""

    dynamics: RobotDynamics
    envelope: VelocityEnvelope
    stop: VerifiedStop | None  # none where no obstacles are known
    servo: JointVelocityServo
    limit: TorqueLimit

    @property
    def command_input(self) -> InputPort:
        """Commanded joint velocity, n (rad/s or m/s), of any controller."""
        return self.envelope.GetInputPort("velocity_commanded")

    @property
    def velocity_output(self) -> OutputPort:
        """Joint velocity that the servo follows, n (rad/s or m/s)."""
        return (self.stop or self.envelope).GetOutputPort("velocity_applied")

    @property
    def torque_output(self) -> OutputPort:
        """Joint torque, n (Nm or N)."""
        return self.limit.GetOutputPort("torque_applied")


def add_velocity_pipeline(
    builder: DiagramBuilder,
    robot: RobotModel,
    measured: JointState,
    params: VelocityPipelineParameters | None = None,
    things: OutputPort | None = None,
    people: OutputPort | None = None,
) -> VelocityPipeline:
    """Add envelope, verified stop, servo and torque limit, and connect them; the command is left to connect.

    Parameters
    ----------
    builder : DiagramBuilder
    robot : RobotModel
        Where a stop is to be verified, with shapes.
    measured : JointState
        At the servo's rate.
    params : VelocityPipelineParameters, optional
    things, people : OutputPort, optional
        Abstract `ObstaclePoints`: those that do as they are predicted, and those that can do what people can. Without
        both no stop is verified.
    """
    params, add = params or VelocityPipelineParameters(), builder.AddNamedSystem
    guarded, stop = things is not None or people is not None, replace(params.stop, motion=params.envelope)
    p = VelocityPipeline(
        dynamics=add("dynamics", RobotDynamics(robot)),
        envelope=add("velocity_envelope", VelocityEnvelope(robot, params.envelope)),
        stop=add("verified_stop", VerifiedStop(robot, stop)) if guarded else None,
        servo=add("joint_servo", JointVelocityServo(robot, params.servo)),
        limit=add("torque_limit", TorqueLimit(robot, params.servo.period)),
    )
    connect(builder, (p.dynamics, "dynamics", p.servo), (p.servo, "torque_commanded", p.limit))
    for source, system, name in (
        (measured.position, p.dynamics, "position_measured"),
        (measured.velocity, p.dynamics, "velocity_measured"),
        (measured.position, p.envelope, "position_measured"),
        (measured.position, p.stop, "position_measured"),
        (p.envelope.GetOutputPort("velocity_applied"), p.stop, "velocity_commanded"),
        (things, p.stop, "things"),
        (people, p.stop, "people"),
        (p.velocity_output, p.servo, "velocity_commanded"),
    ):
        if system is not None and source is not None:
            builder.Connect(source, system.GetInputPort(name))
    return p
