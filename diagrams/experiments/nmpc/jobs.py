"""Jobs of the predictive control: test points, obstacles and references of Section 3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.nmpc.parameters import NmpcReference, TestPoint
from saphari_drake.errors import ModelError
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Pose = tuple[Array, Array]  # rotation (3, 3) and position (3,) in the world

# The arm's points are where the published problem has them, on its Denavit-Hartenberg frames: its frames 1, 3 and 5 sit
# at the far end of our links 1, 3 and 5; the frames 2, 4, 6 and 7 are our own.
ARM_POINTS = (
    TestPoint("shoulder", "link_1", [0.0, 0.0, 0.2005], 0.2, 1e-4),
    TestPoint("upper_arm", "link_2", [0.0, 0.0, 0.2], 0.2, 1e-4),
    TestPoint("elbow", "link_3", [0.0, 0.0, 0.2], 0.2, 1e-4),
    TestPoint("forearm_1", "link_4", [0.0, 0.0, 0.13], 0.2, 1e-4),
    TestPoint("forearm_2", "link_4", [0.0, 0.0, 0.26], 0.2, 1e-4),
    TestPoint("wrist", "link_5", [0.0, 0.0, 0.19], 0.2, 1e-4),
    TestPoint("hand", "link_6", [0.0, 0.0, 0.04], 0.2, 1e-4),
    TestPoint("flange", "link_7", [0.0, 0.0, 0.0], 0.2, 1e-4),
)
OMNIROB_POINTS = (
    TestPoint("platform_front", "platform", [0.3, 0.0, 0.35], 0.6, 5e-4),
    TestPoint("platform_rear", "platform", [-0.3, 0.0, 0.35], 0.6, 5e-4),
    *ARM_POINTS,
)

# m, world; (x, y, z) of the six obstacles of Fig. 2.
OBSTACLES: Array = np.array(
    [
        [-0.36, 2.55, 0.20],
        [1.00, 3.15, 0.25],
        [0.14, 2.70, 1.27],
        [-0.24, 2.95, 1.10],
        [0.05, 3.10, 0.95],
        [-0.05, 2.80, 1.52],
    ]
)


@dataclass(frozen=True)
class NmpcJob:
    """What a robot has to do, and among what.

    Attributes
    ----------
    robot : RobotModel
        Starts at its home posture.
    end_effector : str
        Frame that follows the reference.
    points : tuple of TestPoint
    reference : callable
        Time (s) to the desired pose of the end effector.
    obstacles : callable
        Time (s) to the obstacle points as they really are.
    """

    robot: RobotModel
    end_effector: str
    points: tuple[TestPoint, ...]
    reference: Callable[[float], Pose]
    obstacles: Callable[[float], ObstaclePoints]

    def horizon_reference(self, time: float, period: float, horizon: int) -> NmpcReference:
        """Return the desired poses at `time` and the following control periods, one more than the horizon needs."""
        poses = [self.reference(time + k * period) for k in range(horizon + 2)]
        return NmpcReference(np.array([p for _, p in poses]), np.array([R for R, _ in poses]))


def fixed_obstacles(p_WO: Array) -> Callable[[float], ObstaclePoints]:
    """Return obstacle points (m, 3) that never move."""
    count = len(p_WO)
    return lambda time: ObstaclePoints(p_WO, np.zeros((count, 3)), np.zeros(count), time)


def pose_of(robot: RobotModel, frame: str, q: Array) -> Pose:
    """Return rotation and position of a frame at joint positions `q`."""
    return frame_pose(robot, frame, evaluate_dynamics(robot, q, np.zeros(robot.n)))


def frame_pose(robot: RobotModel, frame: str, terms: DynamicsTerms) -> Pose:
    """Return rotation and position of a frame, from the poses of the links."""
    link, X_LF = robot.frame(frame)
    if link < 0:
        raise ModelError(f"{robot.name}: frame '{frame}' does not move")
    R, p = terms.R_WL[link], terms.p_WL[link]
    return R @ X_LF.rotation().matrix(), p + R @ X_LF.translation()


def point_positions(robot: RobotModel, points: tuple[TestPoint, ...], terms: DynamicsTerms) -> Array:
    """Return the positions (k, 3) of test points in the world, from the poses of the links."""
    rows = []
    for point in points:
        link, X_LF = robot.frame(point.frame)
        rows.append(terms.p_WL[link] + terms.R_WL[link] @ (X_LF @ np.array(point.p_FC, dtype=float)))
    return np.array(rows)


def clearance(p_WC: Array, points: tuple[TestPoint, ...], obstacles: ObstaclePoints) -> float:
    """Return the least distance of test points (k, 3) from obstacles, less their radii and each point's d_min (m)."""
    if len(obstacles.p_WO) == 0:
        return np.inf
    away = np.linalg.norm(p_WC[:, None] - np.asarray(obstacles.p_WO)[None], axis=2)
    return float(np.min(away - np.asarray(obstacles.radius)[None] - np.array([[point.d_min] for point in points])))
