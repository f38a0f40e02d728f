"""Starts and ends the process that talks to a robot."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import time
from types import TracebackType
from typing import Self

from saphari_drake.errors import SensorError
from saphari_drake.robots.model import RobotModel
from saphari_drake.stations.loop import READY, LoopSetup
from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.shared import open_link

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class StationProcess:
    """The process of a robot's loop, and the memory that it shares with this one. Use it with ``with``.

    It is ready when the robot answers: the posture is held from then on.

    Parameters
    ----------
    address : str
        Of the robot: see `saphari_drake.stations.arm.connect`.
    robot : RobotModel
        Its model; its home is of no matter here.
    params : StationParameters, optional

    Attributes
    ----------
    link : Link
        For `RobotStation`.
    pid : int
        Of the loop.

    Raises
    ------
    SensorError
        If the robot does not answer; in one line what the loop said.
    """

    def __init__(self, address: str, robot: RobotModel, params: StationParameters | None = None) -> None:
        params = params or StationParameters()
        self.link = open_link(robot.n)
        self._errors, self._last = tempfile.TemporaryFile(), ""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "saphari_drake.stations.loop"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env={**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,
        )
        self.pid = self._process.pid
        told, heard = self._process.stdin, self._process.stdout
        if told is None or heard is None:
            raise SensorError("the loop has no pipes")
        with told:
            pickle.dump(LoopSetup(address, robot, params, self.link.path), told)
        if heard.readline().decode().strip() != READY:
            self._process.wait()
            self.link.path.unlink(missing_ok=True)
            raise SensorError(self.said() or "the loop ended before it was ready")
        while not self.time() > 0.0:
            if self._process.poll() is not None:
                raise SensorError(self.said())
            time.sleep(0.001)

    def time(self) -> float:
        """Return the time of the robot since the loop's start (s)."""
        reading = self.link.reading.read()
        return 0.0 if reading is None else float(reading["time"][0])

    @property
    def running(self) -> bool:
        """Whether the loop runs."""
        return self._process.poll() is None

    def said(self) -> str:
        """Return the last line that the loop said of an error; "" for none."""
        if self._errors.closed:
            return self._last
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else ""

    def close(self, timeout: float = 5.0) -> None:
        """Leave the robot to itself, standing, and end the loop."""
        if self.running:
            self.link.command.write(close=1.0)
            try:
                self._process.wait(timeout)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        self._last = self.said()
        self._errors.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
