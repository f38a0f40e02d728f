"""Velocity commands for a platform whose wheels cannot slip sideways."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.errors import ParameterError
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


def without_slip(velocity: Array, heading: float, base: Sequence[int]) -> Array:
    """Return a velocity command (n,) whose platform moves along its heading only.

    ẋ = v cos θ, ẏ = v sin θ with v = ẋ_c cos θ + ẏ_c sin θ, so that −ẋ sin θ + ẏ cos θ = 0 at every heading. A command
    that is held while the platform turns thus becomes an arc. With the direction that the command is meant for, the
    heading halfway through the turn, the arc ends where the straight motion would, within v T (ω T)²/12.

    Parameters
    ----------
    velocity : (n,) array
        Joint velocity command (m/s, rad/s).
    heading : float
        θ (rad).
    base : sequence of 3 ints
        Joints x, y and θ of the platform.
    """
    x, y, _ = base
    c, s = np.cos(heading), np.sin(heading)
    forward = velocity[x] * c + velocity[y] * s
    result = np.array(velocity, dtype=float)
    result[x], result[y] = forward * c, forward * s
    return result


def lateral_slip(heading: Array, velocity: Array, base: Sequence[int]) -> Array:
    """Return −ẋ sin θ + ẏ cos θ (m/s), (T,), for headings (T,) and joint velocities (T, n)."""
    x, y, _ = base
    return -velocity[:, x] * np.sin(heading) + velocity[:, y] * np.cos(heading)


class PlatformTwist(LeafSystem):
    """Turns velocity commands into those that a platform without lateral slip can follow, at every servo step.

    .. pydrake_system::

        name: PlatformTwist
        input_ports:
        - position_measured
        - velocity_commanded
        output_ports:
        - velocity_feasible

    Ports
    -----
    position_measured : n (rad or m).
    velocity_commanded : n (rad/s or m/s), held over a control cycle.
    velocity_feasible : n, the same with the platform's part along its measured heading (`without_slip`).

    Parameters
    ----------
    robot : RobotModel
    base : sequence of str
        Joints x, y and θ of the platform.
    """

    def __init__(self, robot: RobotModel, base: Sequence[str]) -> None:
        super().__init__()
        if len(base) != 3:
            raise ParameterError("base", f"needs the joints x, y and theta, got {list(base)}")
        self._base = [robot.joint_index(name) for name in base]
        self._position = self.DeclareVectorInputPort("position_measured", BasicVector(robot.n))
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(robot.n))
        self.DeclareVectorOutputPort(
            "velocity_feasible",
            BasicVector(robot.n),
            self._calc,
            prerequisites_of_calc={self._position.ticket(), self._command.ticket()},
        )

    def _calc(self, context: Context, output: BasicVector) -> None:
        heading = self._position.Eval(context)[self._base[2]]
        output.SetFromVector(without_slip(self._command.Eval(context), heading, self._base))
