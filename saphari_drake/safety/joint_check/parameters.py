"""What encoders and drives may differ by, before they are not believed any more."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.parameters import diagonal, require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class JointCheckParameters:
    """Tolerances; each follows from what a sound joint may show. All assumed."""

    # Times the speed limit at which no joint moves, even pushed, and rad (m) beyond it that a reading may be wrong by.
    speed_factor: float = 2.0
    slack: float = 0.002
    # rad/s² (m/s²); no joint comes to rest faster: what it moved with, squared, over twice this is the way it needs.
    stop_acceleration: float = 40.0
    # Samples, and s (the lag of the speed before them), without any change that count as standing still.
    still_samples: int = 3
    smoothing: float = 0.01
    # rad (m); by how much the second encoder may differ: its step, and what the gear gives way under load.
    encoder_tolerance: float = 0.01
    # Nm; mean error of a torque: offset (0.2) and ripple (0.2) of a drive, and four deviations of the noise that is
    # left of 0.05 Nm. One value, or one a joint (N of a prismatic one).
    torque_tolerance: list[float] | float = 0.6
    # s; over which the torque's error is averaged.
    torque_time: float = 0.015
    # s; how long all must be consistent again before a joint is believed.
    recovery_time: float = 0.5
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        require_positive(
            self, "speed_factor", "stop_acceleration", "still_samples", "smoothing", "encoder_tolerance",
            "torque_tolerance", "torque_time", "recovery_time", "period",
        )  # fmt: skip
        require_non_negative(self, "slack")


class Tolerances(NamedTuple):
    """The parameters of one robot, for the compiled law."""

    step: Array  # (n,) rad or m, largest change of a reading in a period
    stop_acceleration: float
    slack: float
    still_samples: int
    share: float  # of the newest sample in the speed
    encoder: float
    torque: Array  # (n,)
    torque_share: float  # of the newest sample in the torque's error
    recovery: int  # periods
    period: float


def tolerances(robot: RobotModel, params: JointCheckParameters) -> Tolerances:
    """Return the tolerances of a robot; without a speed limit a joint may jump."""
    p = params
    return Tolerances(
        p.speed_factor * robot.v_max * p.period + p.slack,
        p.stop_acceleration,
        p.slack,
        int(p.still_samples),
        float(-np.expm1(-p.period / p.smoothing)),
        p.encoder_tolerance,
        diagonal(p.torque_tolerance, robot.n, "torque_tolerance"),
        float(-np.expm1(-p.period / p.torque_time)),
        int(np.ceil(p.recovery_time / p.period)),
        p.period,
    )
