"""Whole-body recordings: BVH files, and where the joints of their skeletons are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import SensorError

Array = NDArray[np.float64]
_AXES = {"X": 0, "Y": 1, "Z": 2}


@dataclass(frozen=True)
class BodyRecording:
    """Positions of the joints of a skeleton over time, in the frame and unit of its file.

    Attributes
    ----------
    names : tuple of str
        Joints, parents first.
    parents : tuple of int
        Index of each joint's parent, −1 for the root.
    points : (T, J, 3) array
    rate : float
        Frames a second.
    source : str
        File, or what made it.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    points: Array
    rate: float
    source: str

    def index(self, name: str) -> int:
        """Return the index of a joint (`SensorError` if the skeleton has none of this name)."""
        if name not in self.names:
            raise SensorError(f"{self.source}: no joint '{name}'; there are: {', '.join(self.names)}")
        return self.names.index(name)


@dataclass
class _Joint:
    name: str
    parent: int
    offset: Array
    channels: list[str]


def read_bvh(path: str | Path) -> BodyRecording:
    """Read a BVH file; rotations are applied in the order of its channels, each about the axis that they left.

    Raises
    ------
    SensorError
        If the file is missing or no such file, a frame has another number of values, or holds something else than
        finite numbers.
    """
    file = Path(path)
    if not file.is_file():
        raise SensorError(f"{file}: no such file")
    head, found, tail = file.read_text(encoding="utf-8", errors="replace").partition("MOTION")
    if not found or not head.split() or head.split()[0] != "HIERARCHY":
        raise SensorError(f"{file}: needs the parts HIERARCHY and MOTION of a BVH file")
    joints = _hierarchy(file, head.split()[1:])
    count = sum(len(joint.channels) for joint in joints)
    lines = [line for line in tail.splitlines() if line.strip()]
    try:
        frames, period = int(lines[0].split(":")[1]), float(lines[1].split(":")[1])
        rows = [[float(cell) for cell in line.split()] for line in lines[2:]]
    except (IndexError, ValueError) as error:
        raise SensorError(f"{file}: motion cannot be read ({error})") from error
    for number, row in enumerate(rows):
        if len(row) != count:
            raise SensorError(f"{file}: frame {number} has {len(row)} values, {count} are needed")
    if len(rows) != frames or frames == 0 or not period > 0.0:
        raise SensorError(f"{file}: tells {frames} frames of {period} s, and holds {len(rows)}")
    values = np.array(rows)
    if not np.isfinite(values).all():
        raise SensorError(f"{file}: holds a value that is not finite")
    names, parents = tuple(joint.name for joint in joints), tuple(joint.parent for joint in joints)
    return BodyRecording(names, parents, joint_positions(joints, values), 1.0 / period, str(file))


def _hierarchy(file: Path, words: list[str]) -> list[_Joint]:
    joints: list[_Joint] = []
    above: list[int] = []  # indices of the joints whose braces are open; −1: an end site
    k = 0
    try:
        while k < len(words):
            word = words[k]
            if word in ("ROOT", "JOINT"):
                joints.append(_Joint(words[k + 1], above[-1] if above else -1, np.zeros(3), []))
                current, k = len(joints) - 1, k + 2
            elif word == "End":
                current, k = -1, k + 2
            elif word == "{":
                above.append(current)
                k += 1
            elif word == "}":
                above.pop()
                k += 1
            elif word == "OFFSET":
                if above[-1] >= 0:
                    joints[above[-1]].offset = np.array([float(cell) for cell in words[k + 1 : k + 4]])
                k += 4
            elif word == "CHANNELS":
                size = int(words[k + 1])
                joints[above[-1]].channels = words[k + 2 : k + 2 + size]
                k += 2 + size
            else:
                raise ValueError(f"'{word}' is not expected")
    except (IndexError, ValueError, UnboundLocalError) as error:
        raise SensorError(f"{file}: hierarchy cannot be read ({error})") from error
    known = {f"{axis}{kind}" for axis in _AXES for kind in ("position", "rotation")}
    wrong = [channel for joint in joints for channel in joint.channels if channel not in known]
    if wrong or not joints or above:
        raise SensorError(f"{file}: hierarchy cannot be read ({wrong[0] if wrong else 'braces do not match'})")
    return joints


def joint_positions(joints: list[_Joint], values: Array) -> Array:
    """Return where the joints are (T, J, 3), by the channels of the frames (T, sum of channels; deg)."""
    p, R = np.zeros((len(values), len(joints), 3)), np.zeros((len(values), len(joints), 3, 3))
    column = 0
    for j, joint in enumerate(joints):
        turn, shift = np.tile(np.eye(3), (len(values), 1, 1)), np.tile(joint.offset, (len(values), 1))
        for channel in joint.channels:
            axis, value = _AXES[channel[0]], values[:, column]
            column += 1
            if channel.endswith("position"):
                shift[:, axis] += value
            else:
                turn = turn @ _rotations(axis, np.deg2rad(value))
        if joint.parent < 0:
            p[:, j], R[:, j] = shift, turn
        else:
            p[:, j] = p[:, joint.parent] + np.einsum("tij,tj->ti", R[:, joint.parent], shift)
            R[:, j] = R[:, joint.parent] @ turn
    return p


def _rotations(axis: int, angle: Array) -> Array:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.tile(np.eye(3), (len(angle), 1, 1))
    c, s = np.cos(angle), np.sin(angle)
    R[:, i, i], R[:, j, j], R[:, j, i], R[:, i, j] = c, c, s, -s
    return R
