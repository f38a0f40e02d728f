"""What a station is told beside its robot."""

from dataclasses import dataclass, field

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters


def _envelope() -> JointEnvelopeParameters:
    # The robot adds its weight itself: what changes of it between two cycles counts against the robot's 1000 Nm/s.
    # Velocities of a real robot's interface are samples.
    return JointEnvelopeParameters(torque_rate=800.0, velocity_age=0.0)


@dataclass
class StationParameters:
    """The loop that talks to the robot, and its watch over the diagram that commands."""

    # s; the diagram's cycle: how often the station samples and commands.
    period: float = 0.002
    # Limits that no command leaves; its period is that of the robot.
    envelope: JointEnvelopeParameters = field(default_factory=_envelope)
    # 1/s; observer of what others do to the robot, for the envelope alone.
    observer_gain: float = 50.0
    # s, on the robot's clock; a command for a sample older than this comes from a diagram that is dead or hangs: the
    # robot is braked. Assumed; the FCI itself gives a client 20 ms.
    stale_time: float = 0.03
    # s; so long the robot is held after it was braked, when the diagram ends or has died, before the loop ends.
    end_time: float = 0.5
    # 1/s; with which velocities die out when the robot is braked, as far as the envelope's motors can.
    brake_damping: float = 30.0
    # rad/s or m/s; below it a braked robot stands, and its posture is held.
    standing_speed: float = 0.02
    # Real-time priorities (1–99; 0: none) that the loop and the diagram ask for. They go on without, if refused.
    priority: int = 50
    diagram_priority: int = 20

    def __post_init__(self) -> None:
        require_positive(self, "period", "observer_gain", "stale_time", "brake_damping", "standing_speed")
        require_non_negative(self, "end_time")
        for name in ("priority", "diagram_priority"):
            if not 0 <= getattr(self, name) <= 99:
                raise ParameterError(name, f"must lie between 0 and 99, got {getattr(self, name)}")
        if self.brake_damping * self.envelope.period > 0.5:
            raise ParameterError("brake_damping", f"must not exceed {0.5 / self.envelope.period:g} 1/s")
