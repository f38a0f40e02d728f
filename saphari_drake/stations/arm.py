"""What a loop needs of a robot, whatever its interface, and how it gets it from an address."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError

Array = NDArray[np.float64]


class ArmReading(NamedTuple):
    """One state of a robot with n joints."""

    q: Array  # (n,) rad or m
    v: Array  # (n,) rad/s or m/s
    torque: Array  # (n,) Nm or N, as the robot measures it; NaN where it does not
    time: float  # s, of the robot's own clock
    success: float = np.nan  # share of its last cycles in which it got a command; NaN: not told


class Arm(Protocol):
    """A robot that takes a torque in each of its cycles."""

    def read(self) -> ArmReading:
        """Wait for the next state; `SensorError` if there will be none."""
        ...

    def write(self, torque: Array, gravity: Array) -> None:
        """Answer it with torques (n,) (Nm or N); the weight (n,) is part of them, and left to a robot that carries it.

        `SensorError` if the robot does not take them.
        """
        ...

    def finish(self) -> None:
        """Leave the robot to itself, standing."""
        ...


def connect(address: str, n: int) -> Arm:
    """Return the robot at an address: fci://HOST, or lcm, or lcm://URL (as udpm://239.255.76.67:7667?ttl=0).

    Raises
    ------
    ParameterError
        If there is no such kind of address, or the robot has another number of joints.
    SensorError
        If the robot does not answer, or the package for it is missing.
    """
    kind, _, rest = address.partition("://")
    if kind == "fci" and rest:
        from saphari_drake.stations.fci import FciArm

        if n != 7:
            raise ParameterError("robot", f"an arm of Franka has 7 joints, this model has {n}")
        return FciArm(rest)
    if kind == "lcm":
        from saphari_drake.stations.lcm import LcmArm

        return LcmArm(n, rest)
    raise ParameterError("robot", f"'{address}' is none of fci://HOST, lcm, lcm://URL")
