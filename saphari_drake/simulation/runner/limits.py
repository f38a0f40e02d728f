"""How much of the joints' limits a run used: two metrics of every experiment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import StateError
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.runner.results import Metric

Array = NDArray[np.float64]


def limit_metrics(robot: RobotModel, velocity: Array, torque_excess: Array | None) -> list[Metric]:
    """Return the largest share of a joint's speed limit, and the largest torque that limits cut off.

    Neither decides a verdict. A joint without a speed limit has a share of 0.

    Parameters
    ----------
    robot : RobotModel
    velocity : (T, n) array
        Joint velocities (rad/s or m/s), a sample every 1 ms.
    torque_excess : (T, n) array, optional
        What was asked for beyond the limits (Nm or N); None for an arm without torques.
    """
    speed = _checked(robot, velocity, "velocity") / robot.v_max
    metrics = [Metric("joint_speed_share_max", np.abs(speed).max(), "1", high=1.0, decides=False)]
    if torque_excess is not None:
        unit = "Nm" if np.all(robot.tree.kind == REVOLUTE) else "Nm, N"
        excess = np.abs(_checked(robot, torque_excess, "torque_excess")).max()
        metrics.append(Metric("torque_excess_max", excess, unit, high=0.0, decides=False))
    return metrics


def _checked(robot: RobotModel, samples: Array, what: str) -> Array:
    if samples.ndim != 2 or samples.shape[1] != robot.n or len(samples) == 0:
        raise StateError(f"{what}: needs rows of {robot.n} joints, got shape {samples.shape}")
    return samples
