"""Recordings of a force over time, read from the user's CSV, NPZ or MATLAB file, to be played into a simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.parameters import require_non_negative, require_within
from saphari_drake.simulation.people.force_files import runs_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ForceRecording:
    """A force over time.

    Attributes
    ----------
    time : (T,) array
        Strictly increasing times from 0 on (s).
    force : (T, 3) array
        Force in the axes of the recording (N), finite.
    source : str
        The file, with the run in it, and where the times come from.
    """

    time: Array
    force: Array
    source: str

    @property
    def duration(self) -> float:
        """Time from the first row to the last (s)."""
        return float(self.time[-1])

    def at(self, time: float) -> Array:
        """Return the force (3,) at a time (s), interpolated; outside the recording the first or the last one."""
        return np.array([np.interp(time, self.time, column) for column in self.force.T])

    def scaled(self, peak: float, centred: bool = False) -> tuple[Self, float]:
        """Return the recording, its mean taken out if `centred`, with a largest force of `peak` (N), and the factor.

        Raises
        ------
        SensorError
            If it holds no force.
        """
        force = self.force - self.force.mean(axis=0) if centred else self.force
        largest = float(np.max(np.linalg.norm(force, axis=1)))
        if largest <= 0.0:
            raise SensorError(f"{self.source}: holds no force")
        return replace(self, force=force * (peak / largest)), peak / largest


STRONGEST = 1000.0  # N; more than a person pushes with


@dataclass
class RecordingParameters:
    """Which recorded force is played, and how large."""

    # File with the recording: CSV, NPZ or MAT; empty: the synthetic one that comes with the script.
    file: str = ""
    # Which run of a file that holds several.
    index: int = 0
    # 1/s; sample rate, if the file does not tell it (0: read it from the file).
    rate: float = 0.0
    # N; the recording is scaled so that its largest force has this size. Assumed.
    peak: float = 15.0

    def __post_init__(self) -> None:
        require_within(self, 1e-3, STRONGEST, "peak")
        require_non_negative(self, "index", "rate")

    def read(self, synthetic: Path) -> ForceRecording:
        """Return the recording; `synthetic` is played if no file is named."""
        return read_force_recording(self.file or synthetic, index=self.index, rate=self.rate or None)


def read_force_recording(
    path: str | Path, *, index: int = 0, rate: float | None = None, max_gap: float = 0.05
) -> ForceRecording:
    """Read a recording.

    - ``.csv``: columns time, fx, fy, fz (s, N), by name if there is a header (others are ignored), else these four
      in this order; separated by comma, semicolon or tab.
    - ``.npz``: array ``force`` or ``F``; ``.mat``: a struct array with ``F``; (3, T) or (T, 3) in N. Times come from
      ``time`` (s), else from `rate`, else from ``pos`` (m) and ``vel`` (m/s): the uniform period with which integrated
      velocity fits position best.

    Rows without a force (NaN) are interpolated over at most `max_gap`; at either end as many are cut off.

    Parameters
    ----------
    path : path
    index : int
        Run in a struct array.
    rate : float, optional
        Rows a second, for files without times (Hz).
    max_gap : float
        Longest gap that is repaired (s).

    Raises
    ------
    SensorError
        If the file is missing or cannot be used; the message names the row or lists what the file has.
    """
    file = Path(path)
    if rate is not None and not (np.isfinite(rate) and rate > 0.0):
        raise ParameterError("rate", f"must be positive and finite, got {rate}")
    if not (np.isfinite(max_gap) and max_gap >= 0.0):
        raise ParameterError("max_gap", f"must not be negative, got {max_gap}")
    runs = runs_of(file)
    if not 0 <= index < len(runs):
        raise SensorError(f"{file}: no run {index}; it has {len(runs)}, counted from 0")
    time, force, how = _timed(file, runs[index], rate)
    source = f"{file.name}, run {index}, {how}" if "F" in runs[index] else file.name
    return _clean(file, time, force, source, max_gap, runs[index].get("rows"))


def count_runs(path: str | Path) -> int:
    """Return how many runs a recording holds."""
    return len(runs_of(Path(path)))


def fitted_period(position: ArrayLike, velocity: ArrayLike) -> float:
    """Return the uniform sample period (s) that makes integrated velocity fit position best (least squares).

    Ratios of single steps scatter with noise and with lost samples; the fit over the whole run does not.

    Parameters
    ----------
    position, velocity : (T, 3) arrays
        In m and m/s.
    """
    p, v = np.asarray(position, dtype=float), np.asarray(velocity, dtype=float)
    steps = np.nan_to_num(0.5 * (v[1:] + v[:-1]))
    path = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    good = np.all(np.isfinite(p), axis=1)
    if np.count_nonzero(good) < 2:
        return 0.0
    path, p = path[good] - path[good].mean(axis=0), p[good] - p[good].mean(axis=0)
    energy = float(np.sum(path * path))
    return float(np.sum(path * p)) / energy if energy > 0.0 else 0.0


def _timed(file: Path, run: Mapping[str, Any], rate: float | None) -> tuple[Array, Array, str]:
    """Return times (T,) and forces (T, 3) of a run, and where the times come from."""
    name = "F" if "F" in run else "force"
    if name not in run:
        raise SensorError(f"{file}: no array {name}; there are: {', '.join(run) or 'none'}")
    force = _by_rows(file, name, run[name])
    if "time" in run:
        return _numbers(file, "time", run["time"]).reshape(-1), force, "its own times"
    if rate is not None:
        return np.arange(len(force), dtype=np.float64) / rate, force, f"rate {rate:g} Hz given"
    if "pos" not in run or "vel" not in run:
        raise SensorError(f"{file}: no time, nor pos and vel to tell the rate; give the rate")
    pos, vel = _by_rows(file, "pos", run["pos"]), _by_rows(file, "vel", run["vel"])
    if not len(pos) == len(vel) == len(force):
        raise SensorError(f"{file}: F, pos and vel have {len(force)}, {len(pos)} and {len(vel)} rows")
    period = fitted_period(pos, vel)
    if not period > 0.0:
        raise SensorError(f"{file}: pos and vel do not tell the rate (no motion, or against each other); give the rate")
    return period * np.arange(len(force), dtype=float), force, f"rate {1.0 / period:.0f} Hz fitted to pos and vel"


def _numbers(file: Path, name: str, value: Any) -> Array:
    try:
        return np.asarray(value, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise SensorError(f"{file}: {name} does not hold numbers") from error


def _by_rows(file: Path, name: str, value: Any) -> Array:
    """Return a (T, 3) array from (3, T) or (T, 3); a square one is taken as (3, T) for MATLAB's F, pos and vel."""
    array = _numbers(file, name, value)
    if array.size == 0:
        raise SensorError(f"{file}: {name} is empty")
    if array.ndim != 2 or 3 not in array.shape:
        raise SensorError(f"{file}: {name} has shape {array.shape}, three components are needed")
    by_rows = array.shape[1] == 3 and (array.shape[0] != 3 or name == "force")
    return array if by_rows else array.T


def _clean(
    file: Path, time: Array, force: Array, source: str, max_gap: float, labels: Sequence[str] | None
) -> ForceRecording:
    """Check times and repair short gaps; rows are named by `labels`, else by their number from 1."""

    def row(k: int) -> str:
        return labels[k] if labels is not None else f"row {k + 1}"

    if len(time) != len(force):
        raise SensorError(f"{file}: {len(time)} times for {len(force)} forces")
    if not np.all(np.isfinite(time)):
        raise SensorError(f"{file}: {row(int(np.argmin(np.isfinite(time))))} has no time")
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0)) + 1
        raise SensorError(f"{file}: {row(k)}: time {time[k]:g} s does not come after {time[k - 1]:g} s")
    good = np.all(np.isfinite(force), axis=1)
    kept = np.flatnonzero(good)
    if kept.size < 2:
        raise SensorError(f"{file}: has {kept.size} rows with a force, two are needed")
    known = np.unique(np.concatenate(([0], kept, [len(time) - 1])))
    gaps = np.diff(time[known])
    holes = (np.diff(known) > 1) | ~good[known[:-1]] | ~good[known[1:]]
    if np.any(holes & (gaps > max_gap)):
        k = int(np.argmax(holes & (gaps > max_gap)))
        bad = known[k] if not good[known[k]] else known[k] + 1
        raise SensorError(f"{file}: no force from {row(int(bad))} on for {gaps[k]:.3g} s, more than {max_gap:g} s")
    inside = slice(kept[0], kept[-1] + 1)
    filled = np.column_stack([np.interp(time, time[good], column[good]) for column in force.T])
    return ForceRecording(time[inside] - time[kept[0]], filled[inside], source)
