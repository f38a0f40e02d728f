"""Drake's differential inverse kinematics on the same job, for comparison."""

from __future__ import annotations

import timeit
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.inverse_kinematics import (
    DifferentialInverseKinematicsParameters,
    DifferentialInverseKinematicsStatus,
    DoDifferentialInverseKinematics,
)

from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class DifferentialIKStep(NamedTuple):
    """One step."""

    v: Array  # (n,) joint velocity; zero if there is no solution
    solved: bool


class DifferentialIK:
    """Velocities by `DoDifferentialInverseKinematics`, with components of the robot bounded from above.

    It keeps the direction of the task velocity and slows it down as far as the constraints need. The bounds
    x + T ẋ ≤ x̄ enter as limits of further positions, whose velocities are J_C v.

    Parameters
    ----------
    robot : RobotModel
    period : float
        Control cycle (s).
    bounds : (c,) array
        Upper bounds x̄ of the components.
    """

    def __init__(self, robot: RobotModel, period: float, bounds: Array) -> None:
        self._n, self._bounds = robot.n, bounds
        params = DifferentialInverseKinematicsParameters(robot.n + len(bounds), robot.n)
        params.set_time_step(period)
        free = np.full(len(bounds), -1e6)
        params.set_joint_position_limits((np.append(robot.q_min, free), np.append(robot.q_max, bounds)))
        params.set_joint_velocity_limits((-robot.v_max, robot.v_max))
        params.set_nominal_joint_position(np.append(robot.home, np.zeros(len(bounds))))
        params.set_joint_centering_gain(np.zeros((robot.n + len(bounds), robot.n + len(bounds))))
        self._params = params

    def step(self, q: Array, v: Array, J: Array, rate: Array, x: Array, J_C: Array) -> DifferentialIKStep:
        """Return the velocity for a task J v = rate at positions `q` and components `x` with rows `J_C`."""
        N = np.vstack([np.eye(self._n), J_C])
        N_plus = np.hstack([np.eye(self._n), np.zeros((self._n, len(x)))])
        result = DoDifferentialInverseKinematics(
            np.append(q, x), v, rate, J, self._params, np.asfortranarray(N), np.asfortranarray(N_plus)
        )
        if result.status == DifferentialInverseKinematicsStatus.kNoSolutionFound or result.joint_velocities is None:
            return DifferentialIKStep(np.zeros(self._n), False)
        return DifferentialIKStep(np.array(result.joint_velocities), True)


def median_seconds(call, count: int = 200) -> float:
    """Return the median wall time of a call (s)."""
    call()
    return float(np.median(timeit.repeat(call, number=1, repeat=count)))
