"""Numbers that two processes share, each block of them whole or not at all."""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Mapping
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
_TRIES = 1000


class StationStatus(IntEnum):
    """State of a robot behind a station, also published as a number."""

    OK = 0  # commands are carried out
    WAITING = 1  # no command yet: the posture is held
    STALE = 2  # the command was too old, or not finite: braked, then held, until the station is started again
    LOST = 3  # no state of the robot: the connection has ended


class Block:
    """Named vectors of one writer, for any number of readers.

    The writer makes a count odd, writes, and makes it even again; a reader that saw it odd or changed reads once more
    (sequence lock). The writer never waits.
    """

    def __init__(self, memory: Array, fields: Mapping[str, int]) -> None:
        self._count, self._values = memory[:1].view(np.int64), memory[1:]
        ends = np.cumsum(list(fields.values()))
        self._parts = {name: slice(end - size, end) for (name, size), end in zip(fields.items(), ends)}

    def write(self, **values: ArrayLike) -> None:
        """Replace the named vectors; the others stay."""
        self._count[0] += 1
        for name, value in values.items():
            self._values[self._parts[name]] = value
        self._count[0] += 1

    def read(self) -> dict[str, Array] | None:
        """Return all vectors as they were written together; None if that cannot be had, as of a writer that died."""
        for _ in range(_TRIES):
            before = int(self._count[0])
            copy = self._values.copy()
            if before % 2 == 0 and before == self._count[0]:
                return {name: copy[part] for name, part in self._parts.items()}
        return None


class Link(NamedTuple):
    """What the loop at the robot tells the diagram, and what the diagram tells the loop."""

    reading: Block
    command: Block
    path: Path


def open_link(n: int, path: Path | None = None) -> Link:
    """Return the shared memory for a robot with n joints: new without a path, else that of another process.

    The memory is a file without a disk where the system has such a folder. It lives as long as a process has it open.

    Blocks
    ------
    reading : position (n), velocity (n), torque_measured (n), torque_acting (n), torque_external (n), and one each of
        time (s, of the robot since the start), stamp (s, monotonic clock of the computer), missed (cycles), late
        (cycles that began more than half a period late), longest (s, from one cycle to the next), success (share of
        the robot's last cycles that got a command; NaN: not told), envelope (an `EnvelopeStatus`), status (a
        `StationStatus`).
    command : torque (n), time (s, the robot's, of the sample that it answers; 0: none yet), close (1: end).
    """
    vectors = ("position", "velocity", "torque_measured", "torque_acting", "torque_external")
    scalars = ("time", "stamp", "missed", "late", "longest", "success", "envelope", "status")
    reading = dict.fromkeys(vectors, n) | dict.fromkeys(scalars, 1)
    command = {"torque": n, "time": 1, "close": 1}
    sizes = [1 + sum(fields.values()) for fields in (reading, command)]
    if path is None:
        folder = "/dev/shm" if os.path.isdir("/dev/shm") else None
        handle, name = tempfile.mkstemp(prefix="station-", dir=folder)
        path = Path(name)
        os.ftruncate(handle, 8 * sum(sizes))
    else:
        handle = os.open(path, os.O_RDWR)
    memory = np.frombuffer(mmap.mmap(handle, 8 * sum(sizes)), dtype=np.float64)
    os.close(handle)
    return Link(Block(memory[: sizes[0]], reading), Block(memory[sizes[0] :], command), path)
