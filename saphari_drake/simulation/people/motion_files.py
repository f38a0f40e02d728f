"""Recordings of a person's arms: the text files that hold them, and a synthetic one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import SensorError
from saphari_drake.simulation.people.force_files import text_rows

Array = NDArray[np.float64]

# The joints of a row, in its order; left and right are the person's.
JOINTS = ("left_wrist", "right_wrist", "left_elbow", "right_elbow", "left_shoulder", "right_shoulder")


@dataclass(frozen=True)
class HumanRecording:
    """Positions of a person's joints, as recorded.

    Attributes
    ----------
    points : (T, 6, 3) array
        Joints in the order of `JOINTS`, camera frame (x right, y down, z away; m); NaN where a joint was lost.
    source : str
        File, or what made it.
    """

    points: Array
    source: str


def read_human_motion(path: str | Path) -> HumanRecording:
    """Read a text file with a row a frame and 18 columns: x, y, z of each of `JOINTS`, camera frame, m.

    Numbers are separated by blanks or commas; empty lines and lines that start with # are skipped. A joint with a
    number that is not finite, or with all three zero, was lost: it becomes NaN.

    Raises
    ------
    SensorError
        If there is no such file, a row has another number of columns or holds something else than numbers, or nothing
        in it can be used.
    """
    file = Path(path)
    if not file.is_file():
        raise SensorError(f"{file}: no such file")
    rows = []
    for label, line in text_rows(file):
        cells = line.replace(",", " ").split()
        if len(cells) != 3 * len(JOINTS):
            wanted = f"{3 * len(JOINTS)} are needed (x, y, z of {', '.join(JOINTS)})"
            raise SensorError(f"{file}: {label} has {len(cells)} columns, {wanted}")
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError as error:
            raise SensorError(f"{file}: {label}: {error}") from error
    if not rows:
        raise SensorError(f"{file}: holds no frame")
    points = np.array(rows).reshape(-1, len(JOINTS), 3)
    lost = ~np.all(np.isfinite(points), axis=2) | np.all(points == 0.0, axis=2)
    if np.all(lost):
        raise SensorError(f"{file}: no joint is seen in any of its {len(points)} frames")
    points[lost] = np.nan
    return HumanRecording(points, str(file))


def synthetic_recording(rate: float = 30.0, duration: float = 24.0) -> HumanRecording:
    """Return a made-up person, facing the camera, who reaches forwards with one hand after the other.

    Shoulders 0.95 m away; the wrists rest 0.70 m away. Every 6 s each reaches to about 0.40 m and back again within
    2.4 s, at up to 0.6 m/s; the left one begins. Upper arm and forearm are 0.30 and 0.26 m long.

    Parameters
    ----------
    rate : float
        Frames a second.
    duration : float
        Length (s).
    """
    time = np.arange(round(duration * rate)) / rate
    points = np.empty((time.size, 6, 3))
    for side, sign in enumerate((1.0, -1.0)):  # the person's left is on the camera's right
        shoulder = np.array([0.20 * sign, -0.28, 0.95]) + np.column_stack(
            [0.02 * np.sin(0.5 * time), 0.0 * time, -0.10 * (0.5 - 0.5 * np.cos(0.9 * time))]
        )
        reach = _reach(time - 3.0 * side)
        wrist = np.array([0.16 * sign, 0.06, 0.70]) + np.column_stack(
            [-0.12 * sign * reach, -0.10 * reach, -0.40 * reach]
        )
        elbow, wrist = bent_arm(shoulder, wrist, np.array([0.5 * sign, 1.0, 0.3]))
        points[:, side], points[:, 2 + side], points[:, 4 + side] = wrist, elbow, shoulder
    return HumanRecording(points, "synthetic")


def _reach(time: Array, pause: float = 6.0, lasts: float = 2.4) -> Array:
    """Share of the reach (T,): from 0 to 1 and back, smoothly, once every `pause` (s) from then on."""
    a = np.clip(np.where(time < 0.0, 0.0, time % pause) / lasts, 0.0, 1.0)
    return np.sin(np.pi * a) ** 2


def bent_arm(shoulder: Array, wrist: Array, outward: Array, upper: float = 0.30, lower: float = 0.26):
    """Return elbow and wrist (T, 3) of an arm whose elbow points `outward`; a wrist out of reach is drawn in."""
    way = wrist - shoulder
    length = np.linalg.norm(way, axis=1, keepdims=True)
    unit = way / length
    length = np.minimum(length, 0.98 * (upper + lower))
    along = (upper**2 - lower**2 + length**2) / (2.0 * length)
    side = outward - np.sum(unit * outward, axis=1, keepdims=True) * unit
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    elbow = shoulder + along * unit + np.sqrt(np.maximum(upper**2 - along**2, 0.0)) * side
    return elbow, shoulder + length * unit
