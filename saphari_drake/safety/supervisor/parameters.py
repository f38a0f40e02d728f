"""When the supervisor changes its state."""

from dataclasses import dataclass, field

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_choice, require_non_negative, require_positive

ANSWERS = ("comply", "stop")


@dataclass
class SupervisorParameters:
    """Thresholds with hysteresis, and how long each event lasts before it counts. All assumed."""

    # Share of the commanded speed that people leave: below it the state is slowed, above it free again,
    slow_below: float = 0.95
    free_above: float = 0.99
    # and below it stopped, above it on the way again.
    stop_below: float = 0.005
    go_above: float = 0.05
    # s; how long people must leave room before the robot goes on, and goes on freely.
    go_time: float = 0.1
    free_time: float = 0.2
    # s; how long a touch must last to be answered, and be over before the job is taken up.
    touch_time: float = 0.02
    release_time: float = 0.3
    # s; how long skin or tool must be held to be guided, and be let go.
    taken_time: float = 0.2
    let_go_time: float = 0.5
    # s; how long all must be well, with recovery asked for, before a fault is over.
    recovery_time: float = 0.1
    # What a touch is answered with: a contact controller, or a stop.
    answer: str = "comply"
    # Names of the statuses that tell a fault, in the order of the port `faults`.
    fault_names: list[str] = field(default_factory=list)
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        require_positive(self, "period")
        require_choice(self, "answer", ANSWERS)
        for name in vars(self):
            if name.endswith("_time"):
                require_non_negative(self, name)
        for low, high in (("slow_below", "free_above"), ("stop_below", "go_above")):
            if not 0.0 <= getattr(self, low) < getattr(self, high) <= 1.0:
                raise ParameterError(low, f"must lie in [0, {high}), got {getattr(self, low)}")
