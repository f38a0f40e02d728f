"""KUKA's iiwa, and others that speak the same messages, over LCM as drake-iiwa-driver does."""

from __future__ import annotations

import contextlib
import time

import numpy as np
from drake import lcmt_iiwa_command, lcmt_iiwa_status
from numpy.typing import NDArray
from pydrake.lcm import DrakeLcm

from saphari_drake.errors import SensorError
from saphari_drake.stations.arm import ArmReading

Array = NDArray[np.float64]
STATUS, COMMAND = "IIWA_STATUS", "IIWA_COMMAND"
LOST_TIME = 0.1  # s without a message after which the driver counts as gone. Assumed


class LcmArm:
    """Torque control with the driver's messages; the driver carries the weight.

    The driver has to be in its torque mode. Each status is answered by a command with the measured positions and the
    torques beyond the weight.

    Parameters
    ----------
    n : int
        Number of joints.
    url : str
        Of LCM; empty: its default.
    """

    def __init__(self, n: int, url: str = "") -> None:
        self._n = n
        self._lcm = DrakeLcm(url) if url else DrakeLcm()
        self._latest: bytes | None = None
        self._lcm.Subscribe(STATUS, self._receive)
        self._status = lcmt_iiwa_status()
        self.read()  # the driver is there

    def _receive(self, raw: bytes) -> None:
        self._latest = raw

    def read(self) -> ArmReading:
        """Wait for the next status; of several that have come, the last one."""
        self._latest, started = None, time.monotonic()
        while self._latest is None:
            self._lcm.HandleSubscriptions(5)
            if time.monotonic() - started > LOST_TIME and self._latest is None:
                raise SensorError(f"no {STATUS} in {LOST_TIME} s")
        self._status = status = lcmt_iiwa_status.decode(self._latest)
        if status.num_joints != self._n:
            raise SensorError(f"{STATUS} has {status.num_joints} joints, the model {self._n}")
        q, v, torque = (
            np.array(values)
            for values in (
                status.joint_position_measured,
                status.joint_velocity_estimated,
                status.joint_torque_measured,
            )
        )
        return ArmReading(q, v, torque, 1e-6 * status.utime)

    def write(self, torque: Array, gravity: Array) -> None:
        """Send torques without the weight."""
        message = lcmt_iiwa_command()
        message.utime, message.num_joints, message.num_torques = self._status.utime, self._n, self._n
        message.joint_position = self._status.joint_position_measured
        message.joint_torque = (torque - gravity).tolist()
        self._lcm.Publish(COMMAND, message.encode())

    def finish(self) -> None:
        """Ask for no torque beyond the weight, more than once: a message may be lost."""
        for _ in range(3):
            with contextlib.suppress(SensorError):
                self.read()
            self.write(np.zeros(self._n), np.zeros(self._n))
