"""Judges what the skin says of each touch; what it misses counts in full."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import SensorError
from saphari_drake.simulation.runner.results import Metric

Array = NDArray[np.float64]


class SkinTouch(NamedTuple):
    """One touch of the skin, over the samples in which it is firm."""

    missed_share: float  # of its samples, those without a contact
    force_error: float  # rms of ‖F̂ − F‖/‖F‖, 1 in a sample that is missed
    point_error: float  # rms of the distance from the true point, m, over the samples found; infinite if there are none


def skin_touches(force: Array, estimated: Array, contact: Array, p_LC: Array, on: float, off: float) -> list[SkinTouch]:
    """Return the touches of a run: each lasts while the true force exceeds `off`, and is firm where it exceeds `on`.

    Parameters
    ----------
    force, estimated : (T, 3) arrays
        True and estimated force on the body (N).
    contact : (T, k) array
        Contact point in the link's frame (m), and what else the skin tells of it; zeros where it finds none.
    p_LC : (3,) array
        True point (m).
    on, off : float
        Forces (N), on > off.
    """
    size, found = np.linalg.norm(force, axis=1), np.any(contact != 0.0, axis=1)
    error = np.linalg.norm(estimated - force, axis=1) / np.maximum(size, off)
    error[~found] = 1.0
    away = np.linalg.norm(contact[:, :3] - p_LC, axis=1)
    borders = np.flatnonzero(np.diff(size > off, prepend=False, append=False))
    touches = []
    for start, end in borders.reshape(-1, 2):
        firm = np.arange(start, end)[size[start:end] > on]
        if len(firm):
            seen = firm[found[firm]]
            point = _rms(away[seen]) if len(seen) else np.inf
            touches.append(SkinTouch(1.0 - len(seen) / len(firm), _rms(error[firm]), point))
    return touches


def skin_metrics(touches: Sequence[SkinTouch], suffix: str = "") -> list[Metric]:
    """Return the metrics of the skin, each of the worst touch.

    Raises
    ------
    SensorError
        If there is no touch.
    """
    if not touches:
        raise SensorError("nobody touches the skin")
    missed, force, point = (max(column) for column in zip(*touches))
    return [
        Metric(f"skin_force_error_relative{suffix}", force, "1", high=0.05),
        Metric(f"skin_point_error_m{suffix}", point, "m", high=0.005),
        Metric(f"skin_missed_share{suffix}", missed, "1", high=0.05),
        Metric(f"skin_touches{suffix}", len(touches), "1"),
    ]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
