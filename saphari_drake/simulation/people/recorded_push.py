"""A recorded force as the push of a hand that can press, but not pull."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.math.rotations import rotation_between
from saphari_drake.parameters import require_positive
from saphari_drake.simulation.people.force_recording import ForceRecording, RecordingParameters

Array = NDArray[np.float64]


@dataclass
class RecordedPushParameters(RecordingParameters):
    """How a recording becomes a push. All assumed."""

    # Share of the normal force that the tangential one may reach; must be below the friction of skin on the robot.
    friction_used: float = 0.4
    # N; least normal force.
    least: float = 3.0
    # s; time from the start of the push to that of the recording, and of blending between both.
    lead: float = 2.0
    blend: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "friction_used", "least", "lead", "blend")


@dataclass(frozen=True)
class RecordedPush:
    """A force profile for a `HumanHand`.

    Attributes
    ----------
    profile : callable
        Seconds since the start of the push to a force (3,) in the world (N), or None before the recording.
    bias : float
        Steady push that the recording rides on (N).
    scale : float
        Factor on the recorded force.
    start, end : float
        When the recording plays (s since the start of the push).
    """

    profile: Callable[[float], Array | None]
    bias: float
    scale: float
    start: float
    end: float


def recorded_push(recording: ForceRecording, direction: ArrayLike, params: RecordedPushParameters) -> RecordedPush:
    """Turn a recorded force into a push along `direction` (3,).

    The recording is rotated so that its mean points along the push, scaled to the peak, and lifted by the least steady
    push that keeps it inside the friction cone: a fingertip presses where the recorded hand gripped.

    Raises
    ------
    SensorError
        If the recording holds no force.
    """
    scaled, scale = recording.scaled(params.peak)
    force, unit = scaled.force, np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    mean = force.mean(axis=0)
    steady = np.linalg.norm(mean) > 0.05 * params.peak
    axis = mean if steady else np.linalg.svd(force - mean, full_matrices=False)[2][0]
    turned = replace(scaled, force=force @ rotation_between(axis, unit).T)
    normal = turned.force @ unit
    tangential = np.linalg.norm(turned.force - np.outer(normal, unit), axis=1)
    bias = max(0.0, float(np.max(tangential / params.friction_used + params.least - normal)))
    end = params.lead + turned.duration

    def profile(elapsed: float) -> Array | None:
        if elapsed < params.lead:
            return None
        played = elapsed - params.lead
        weight = min(1.0, played / params.blend, max(0.0, (end - elapsed) / params.blend))
        return bias * unit + weight * turned.at(played)

    return RecordedPush(profile, bias, scale, params.lead, end)
