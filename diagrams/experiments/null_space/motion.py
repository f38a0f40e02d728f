"""Desired motion of a frame: there and back along a straight line, smooth in acceleration."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.simulation.world.references import Reference, rest_to_rest

Array = NDArray[np.float64]


@dataclass
class StraightMotionParameters:
    """Line and timing. All A."""

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


def straight_motion(start: RigidTransform, params: StraightMotionParameters) -> Reference:
    """Return the motion of a frame from a pose in the world along a straight line, and back, again and again.

    Its outputs are held over each period: `desired_pose`, abstract `RigidTransform`; `desired_velocity` and
    `desired_acceleration`, 6, [ω; v] in the world (rad/s, m/s) and its derivative. The orientation is constant.
    """
    T, pause, origin = params.travel_time, params.pause, start.translation()
    there = origin + np.asarray(params.displacement)
    times = np.cumsum([0.0, T, pause, T, pause])
    path = rest_to_rest(times, [origin, there, there, origin, origin])

    def at(time: float, order: int) -> Array:
        since = max(time - params.start, 0.0) % times[-1]
        return (path.EvalDerivative(since, order) if order else path.value(since)).ravel()

    functions = {
        "desired_pose": lambda time: RigidTransform(start.rotation(), at(time, 0)),
        "desired_velocity": lambda time: np.concatenate([np.zeros(3), at(time, 1)]),
        "desired_acceleration": lambda time: np.concatenate([np.zeros(3), at(time, 2)]),
    }
    return Reference(functions, params.period)
