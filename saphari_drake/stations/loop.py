"""The loop at the robot's own rate: a process of its own, which outlives the diagram that commands it.

Started by `StationProcess` as ``python -m saphari_drake.stations.loop``, with a pickled `LoopSetup` on stdin.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saphari_drake.errors import SaphariError
from saphari_drake.robots.model import RobotModel
from saphari_drake.stations.arm import Arm, connect
from saphari_drake.stations.guard import Guard
from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.priority import undisturbed
from saphari_drake.stations.shared import Block, Link, StationStatus, open_link

READY = "ready"


class LoopSetup(NamedTuple):
    """All that the process is told."""

    address: str
    robot: RobotModel
    params: StationParameters
    path: Path


class Cadence:
    """Counts the cycles of a robot: those missed on its own clock, and those late on the computer's."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._time: float | None = None
        self._stamp = 0.0
        self.start, self.missed, self.late, self.longest = 0.0, 0, 0, 0.0

    def tick(self, robot_time: float, stamp: float) -> None:
        """Note one cycle by the times of both clocks (s)."""
        if self._time is None:
            self.start = robot_time
        else:
            self.missed += max(round((robot_time - self._time) / self._period) - 1, 0)
            self.longest = max(self.longest, stamp - self._stamp)
            self.late += stamp - self._stamp > 1.5 * self._period
        self._time, self._stamp = robot_time, stamp


def serve(arm: Arm, guard: Guard, link: Link, params: StationParameters, parent: int) -> None:
    """Read, command and tell, cycle by cycle, until the diagram says so, or is gone and the robot stands.

    Raises
    ------
    SensorError
        If the robot ends the connection.
    """
    cadence, stood = Cadence(params.envelope.period), 0.0
    while True:
        reading = arm.read()
        stamp = time.monotonic()
        cadence.tick(reading.time, stamp)
        given = link.command.read()
        told, closing, alone = given is not None and given["time"][0] > 0.0, False, os.getppid() != parent
        fresh, command = False, np.zeros(len(reading.q)) if told or alone else None
        if given is not None:
            closing = given["close"][0] == 1.0
            command = given["torque"] if told else None
            fresh = reading.time - cadence.start - given["time"][0] <= params.stale_time
        if closing or alone:  # nobody commands any more: to a stop
            command, fresh = np.zeros(len(reading.q)), False
        guarded = guard.step(reading.q, reading.v, command, fresh)
        arm.write(guarded.torque, guarded.gravity)
        _tell(link.reading, reading, guarded, cadence, stamp)
        stood = stood + params.envelope.period if guarded.standing else 0.0
        if (closing or alone) and stood > params.end_time:
            return


def _tell(block: Block, reading, guarded, cadence: Cadence, stamp: float) -> None:
    block.write(
        position=reading.q,
        velocity=reading.v,
        torque_measured=reading.torque,
        torque_acting=guarded.torque,
        torque_external=guarded.external,
        time=reading.time - cadence.start,
        stamp=stamp,
        missed=cadence.missed,
        late=cadence.late,
        longest=cadence.longest,
        success=reading.success,
        envelope=guarded.limited.status,
        status=guarded.status,
    )


def main() -> int:
    """Run the loop of the setup on stdin; return 0, or 1 if the robot cannot be had or has gone (told on stderr)."""
    setup: LoopSetup = pickle.load(sys.stdin.buffer)
    parent = os.getppid()
    link = open_link(setup.robot.n, setup.path)
    with contextlib.suppress(OSError):
        setup.path.unlink()
    try:
        guard = Guard(setup.robot, setup.params)
        arm = connect(setup.address, setup.robot.n)
        print(READY, flush=True)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # that is for the diagram, which closes the station
        with undisturbed(setup.params.priority):
            serve(arm, guard, link, setup.params, parent)
        arm.finish()
    except (SaphariError, OSError) as error:
        link.reading.write(status=StationStatus.LOST, position=np.nan, velocity=np.nan)
        print(" ".join(str(error).split()), file=sys.stderr, flush=True)
        return 1
    link.reading.write(status=StationStatus.LOST, position=np.nan, velocity=np.nan)
    return 0


if __name__ == "__main__":
    sys.exit(main())
