"""Repair of recorded joints: short gaps are interpolated, jumps rejected, lost joints held, and each of it is told."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import SensorError
from saphari_drake.simulation.people.motion_files import JOINTS, HumanRecording

Array = NDArray[np.float64]


class JointState(IntEnum):
    """How the position of a joint in one frame came about."""

    SEEN = 0
    REPAIRED = 1  # interpolated over a short gap
    HELD = 2  # not seen for longer: where it was last seen
    LOST = 3  # held for longer than allowed
    NEVER = 4  # in no frame of the recording: it has no position


@dataclass(frozen=True)
class RepairedMotion:
    """A recording without gaps and jumps.

    Attributes
    ----------
    points : (T, 6, 3) array
        Joints in the camera frame (m); NaN for those never seen.
    state : (T, 6) int array
        A `JointState` each.
    rejected : int
        Readings that were seen and rejected as jumps.
    """

    points: Array
    state: NDArray[np.int64]
    rejected: int


def repair_motion(
    recording: HumanRecording, rate: float, max_speed: float, max_gap: float, hold_time: float, smoothing: float = 0.0
) -> RepairedMotion:
    """Repair a recording.

    A reading is accepted if it lies within `max_speed` times the time since the last accepted one of that joint; so a
    single outlier is dropped, and a joint that is really found elsewhere is accepted after a while. A gap up to
    `max_gap` is interpolated. In a longer one the joint stays where it was last seen and moves, with at most
    `max_speed`, just in time to where it is seen again. No joint ever moves faster than that.

    Parameters
    ----------
    recording : HumanRecording
    rate : float
        Frames a second.
    max_speed : float
        Limit of a joint's speed (m/s).
    max_gap : float
        Longest gap that is interpolated (s).
    hold_time : float
        Time after which a joint that is held counts as lost (s).
    smoothing : float
        Standard deviation of a Gaussian over time (s); 0: none.

    Raises
    ------
    SensorError
        If no joint is seen steadily.
    """
    count = len(recording.points)
    points = np.full_like(recording.points, np.nan)
    state = np.full((count, len(JOINTS)), int(JointState.NEVER))
    rejected = 0
    for j in range(len(JOINTS)):
        raw = recording.points[:, j]
        seen = _accepted(raw, max_speed / rate)
        rejected += int(np.isfinite(raw).all(axis=1).sum() - seen.size)
        if seen.size == 0:
            continue
        points[:, j], state[:, j] = _filled(raw, seen, rate, max_speed, max_gap, hold_time)
        points[:, j] = _smoothed(points[:, j], smoothing * rate)
    if np.all(state == JointState.NEVER):
        raise SensorError(f"{recording.source}: no joint is seen steadily in any of its {count} frames")
    return RepairedMotion(points, state, rejected)


def _accepted(raw: Array, step: float) -> NDArray[np.int64]:
    """Return the frames whose reading (T, 3) can be believed; `step` is the farthest way in one frame (m)."""
    frames = np.flatnonzero(np.isfinite(raw).all(axis=1))

    def agree(a: int, b: int) -> bool:
        return bool(np.linalg.norm(raw[b] - raw[a]) <= step * (b - a))

    # The first reading to believe is one that two of its next three agree with.
    start = next(
        (i for i in range(len(frames)) if sum(agree(frames[i], k) for k in frames[i + 1 : i + 4]) >= 2), len(frames)
    )
    kept: list[int] = []
    for frame in frames[start:]:
        if not kept or agree(kept[-1], frame):
            kept.append(int(frame))
    return np.array(kept, dtype=np.int64)


def _filled(raw: Array, seen: NDArray[np.int64], rate: float, max_speed: float, max_gap: float, hold_time: float):
    """Return positions (T, 3) and states (T,) of one joint from the frames in which it was seen."""
    points, state = raw.copy(), np.full(len(raw), int(JointState.SEEN))
    edges = [(-1, int(seen[0])), *zip(seen[:-1].tolist(), seen[1:].tolist()), (int(seen[-1]), len(raw))]
    for before, after in edges:
        gap = np.arange(before + 1, after)
        if gap.size == 0:
            continue
        if before < 0 or after == len(raw):
            points[gap] = raw[after if before < 0 else before]
            away = (after - gap if before < 0 else gap - before) / rate
        elif (after - before) / rate <= max_gap + 1e-9:
            share = ((gap - before) / (after - before))[:, None]
            points[gap] = (1.0 - share) * raw[before] + share * raw[after]
            state[gap] = JointState.REPAIRED
            continue
        else:
            way = raw[after] - raw[before]
            duration = max(float(np.linalg.norm(way)) / max_speed * rate, 1.0)
            share = np.clip(1.0 - (after - gap) / duration, 0.0, 1.0)[:, None]
            points[gap] = raw[before] + share * way
            away = (gap - before) / rate
        state[gap] = np.where(away > hold_time, int(JointState.LOST), int(JointState.HELD))
    return points, state


def _smoothed(points: Array, sigma: float) -> Array:
    """Filter positions (T, 3) with a Gaussian of `sigma` frames; the ends are extended."""
    half = int(np.ceil(3.0 * sigma))
    if half == 0:
        return points
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    padded = np.pad(points, ((half, half), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(column, kernel / kernel.sum(), mode="valid") for column in padded.T])
