"""Franka's arms (FR3, Panda) over the Franka Control Interface."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import SensorError
from saphari_drake.stations.arm import ArmReading

Array = NDArray[np.float64]


def franka_package() -> Any:
    """Return `pylibfranka`; `SensorError` if it is not installed."""
    try:
        import pylibfranka
    except ImportError as error:
        raise SensorError(f"fci:// needs the extra 'franka': pip install 'saphari_drake[franka]' ({error})") from error
    return pylibfranka


class FciArm:
    """Torque control at 1 kHz; the robot carries its own weight.

    A robot that has stopped for an error stays so until it is told to recover: a connection does that once, at its
    beginning.
    """

    def __init__(self, host: str) -> None:
        self._franka = franka_package()
        try:
            self._robot = self._franka.Robot(host, self._franka.RealtimeConfig.kIgnore)
            if bool(self._robot.read_once().current_errors):
                self._robot.automatic_error_recovery()
            self._control = self._robot.start_torque_control()
        except (RuntimeError, self._franka.FrankaException) as error:
            raise SensorError(f"fci://{host}: {error}") from error
        self._torque = [0.0] * 7

    def read(self) -> ArmReading:
        """Wait for the next state."""
        try:
            state, _ = self._control.readOnce()
        except (RuntimeError, self._franka.FrankaException) as error:
            raise SensorError(f"the robot has stopped: {error}") from error
        q, v, torque = np.array(state.q), np.array(state.dq), np.array(state.tau_J)
        return ArmReading(q, v, torque, state.time.to_sec(), state.control_command_success_rate)

    def write(self, torque: Array, gravity: Array) -> None:
        """Send torques without the weight."""
        self._torque = (torque - gravity).tolist()
        self._send(self._franka.Torques(self._torque))

    def finish(self) -> None:
        """Tell the robot that the motion is finished: its brakes and its own control keep it."""
        last = self._franka.Torques(self._torque)
        last.motion_finished = True
        with contextlib.suppress(SensorError):
            self.read()
            self._send(last)

    def _send(self, torques: Any) -> None:
        try:
            self._control.writeOnce(torques)
        except (RuntimeError, self._franka.FrankaException) as error:
            raise SensorError(f"the robot has stopped: {error}") from error
