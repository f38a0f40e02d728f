"""Desired motion of a frame: there and back along a straight line, smooth in acceleration."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.errors import ParameterError
from saphari_drake.math.curves import quintic
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.simulation.world.references import Reference

Array = NDArray[np.float64]


@dataclass
class StraightMotionParameters:
    """Line and timing. All assumed."""

    # m; to the far end, in the world.
    displacement: list[float] = field(default_factory=lambda: [0.0, 0.2, 0.0])
    # s; first departure, time of one way, and pause at each end.
    start: float = 0.5
    travel_time: float = 3.0
    pause: float = 1.0
    # s; period with which the motion is sampled: that of the controller which follows it.
    period: float = 0.002

    def __post_init__(self) -> None:
        if np.shape(self.displacement) != (3,):
            raise ParameterError("displacement", f"needs three entries, got {self.displacement}")
        require_positive(self, "travel_time", "period")
        require_non_negative(self, "start", "pause")


def share_of_way(params: StraightMotionParameters, time: float) -> tuple[float, float, float]:
    """Return the share of the way (0 to 1), its rate (1/s) and its second derivative (1/s²) at a time (s)."""
    leg, T = params.travel_time + params.pause, params.travel_time
    index, since = divmod(time - params.start, leg)
    if time < params.start:
        return 0.0, 0.0, 0.0
    s, rate, second = (derivative / T**k for k, derivative in enumerate(quintic(since / T)))
    return (s, rate, second) if index % 2 == 0 else (1.0 - s, -rate, -second)


def straight_motion(start: RigidTransform, params: StraightMotionParameters) -> Reference:
    """Return the motion of a frame from a pose in the world along a straight line, and back, again and again.

    Its outputs are held over each period: `desired_pose`, abstract `RigidTransform`; `desired_velocity` and
    `desired_acceleration`, 6, [ω; v] in the world (rad/s, m/s) and its derivative. The orientation is constant.
    """

    def at(time: float, order: int) -> Array:
        return share_of_way(params, time)[order] * np.asarray(params.displacement)

    functions = {
        "desired_pose": lambda time: RigidTransform(start.rotation(), start.translation() + at(time, 0)),
        "desired_velocity": lambda time: np.concatenate([np.zeros(3), at(time, 1)]),
        "desired_acceleration": lambda time: np.concatenate([np.zeros(3), at(time, 2)]),
    }
    return Reference(functions, params.period)
