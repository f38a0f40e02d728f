"""What a person does in a cell: a recording played there, or a made-up way with a hand that reaches."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.parameters import require_non_negative, require_positive, require_vector
from saphari_drake.simulation.people.bvh import BodyRecording, read_bvh
from saphari_drake.simulation.people.motion_files import bent_arm
from saphari_drake.simulation.people.skeleton import (
    R_SHOULDER,
    PersonSizes,
    standing,
    upright,
)

Array = NDArray[np.float64]


@dataclass
class PerformanceParameters:
    """Where a person's motion comes from, and where and how fast it takes place."""

    # BVH file. Empty: made up, by the way below.
    file: str = ""
    # m and deg; where the person is, in the median, and where the person looks: 0 is along x.
    spot: list[float] = field(default_factory=lambda: [1.0, 0.0])
    yaw: float = 180.0
    # s; what the recording shows at the start of the run; it is played forth and back.
    start: float = 0.0
    # m/s; faster parts are played more slowly, so that no joint is faster, and s, the filter over time: readings jump.
    max_speed: float = 1.6
    smoothing: float = 0.04
    # Way of a made-up person, by rows of time (s), x and y (m).
    way: list[list[float]] = field(default_factory=lambda: [[0.0, 2.5, 0.0], [2.0, 1.0, 0.0], [20.0, 1.0, 0.0]])
    # s; from when to when the right hand reaches, where to (m, world), and how fast (m/s).
    reach_from: float = 3.0
    reach_until: float = 6.0
    reach_to: list[float] = field(default_factory=lambda: [0.5, 0.0, 0.7])
    reach_speed: float = 0.8

    def __post_init__(self) -> None:
        require_positive(self, "max_speed", "reach_speed")
        require_non_negative(self, "smoothing", "reach_from")
        require_vector(self, 2, "spot")
        require_vector(self, 3, "reach_to")


class Performance(NamedTuple):
    """A person's motion, sampled.

    Attributes
    ----------
    joints : (T, J, 3) array
        In the world (m).
    rate : float
        Samples a second.
    start : float
        s, in it, at the start of the run.
    source : str
    """

    joints: Array
    rate: float
    start: float
    source: str

    def at(self, time: float) -> Array:
        """Return the joints (J, 3) at a time (s); forth and back."""
        return played(self.joints, (time + self.start) * self.rate)[0]


@njit(cache=True)
def played(samples: Array, at: float) -> tuple[Array, Array]:
    """Return samples (T, …), played forth and back, at a time in samples, and their change over a sample there."""
    last = len(samples) - 1
    if last == 0:
        return samples[0], 0.0 * samples[0]
    x = at % (2.0 * last)
    forth = x <= last
    x = x if forth else 2.0 * last - x
    k = min(int(x), last - 1)
    change = samples[k + 1] - samples[k]
    return samples[k] + (x - k) * change, change if forth else -change


def performance(
    params: PerformanceParameters, sizes: PersonSizes, recording: BodyRecording | None = None
) -> Performance:
    """Return the motion of the parameters; a recording may be given in place of its file.

    Raises
    ------
    SensorError
        If the file cannot be read.
    """
    if recording is None and not params.file:
        return _made_up(params, sizes)
    recording = recording or read_bvh(params.file)
    p = _smoothed(upright(recording, sizes), params.smoothing * recording.rate)
    c, s = np.cos(np.deg2rad(params.yaw)), np.sin(np.deg2rad(params.yaw))
    p = p @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + np.array([*params.spot, 0.0])
    return Performance(_warped(p, recording.rate, params.max_speed), recording.rate, params.start, recording.source)


def _smoothed(p: Array, width: float) -> Array:
    """Filter over time (T, J, 3): jumps by a median of five, the rest by a Gaussian of a width in samples."""
    if len(p) < 5 or width <= 0.0:
        return p
    padded = np.pad(p, ((2, 2), (0, 0), (0, 0)), mode="edge")
    p = np.median(np.stack([padded[k : k + len(p)] for k in range(5)]), axis=0)
    half = int(np.ceil(3.0 * width))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / width) ** 2)
    padded = np.pad(p, ((half, half), (0, 0), (0, 0)), mode="edge")
    rows = [share * padded[k : k + len(p)] for k, share in enumerate(kernel / kernel.sum())]
    return np.asarray(np.sum(rows, axis=0))


def _warped(p: Array, rate: float, max_speed: float) -> Array:
    """Resample so that no joint is faster than `max_speed` (m/s): time is stretched where one would be."""
    if len(p) < 2:
        return p
    steps = np.linalg.norm(np.diff(p, axis=0), axis=2).max(axis=1)
    time = np.concatenate([[0.0], np.cumsum(np.maximum(1.0 / rate, steps / max_speed))])
    at = np.arange(int(time[-1] * rate) + 1) / rate
    flat = p.reshape(len(p), -1)
    return np.stack([np.interp(at, time, column) for column in flat.T], axis=1).reshape(len(at), *p.shape[1:])


def _made_up(params: PerformanceParameters, sizes: PersonSizes, rate: float = 100.0) -> Performance:
    way = np.asarray(params.way, dtype=float)
    time = np.arange(int(way[-1, 0] * rate) + 1) / rate
    spot = np.column_stack([np.interp(time, way[:, 0], way[:, k]) for k in (1, 2)])
    c, s = np.cos(np.deg2rad(params.yaw)), np.sin(np.deg2rad(params.yaw))
    stand = standing(sizes) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    p = stand[None] + np.column_stack([spot, 0.0 * time])[:, None]
    hanging, goal = p[:, -1], np.asarray(params.reach_to, dtype=float)
    out = params.reach_speed * np.clip(np.minimum(time - params.reach_from, params.reach_until - time), 0.0, None)
    length = np.linalg.norm(goal - hanging, axis=1)
    share = np.clip(out / np.maximum(length, 1e-9), 0.0, 1.0)[:, None]
    elbow, wrist = bent_arm(p[:, R_SHOULDER], hanging + share * (goal - hanging), np.array([0.0, 0.0, -1.0]))
    p[:, R_SHOULDER + 1], p[:, R_SHOULDER + 2] = elbow, wrist
    return Performance(p, rate, params.start, "made up")
