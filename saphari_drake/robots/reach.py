"""How far from its shoulder a point of a robot can be brought."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.robots.chain import postures_within
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
STARTS, STEPS = 8, 120


def reach(robot: RobotModel, link: int, p_LC: Array) -> tuple[Array, float]:
    """Return the shoulder (3,), the outermost joint's origin that no joint moves, and the reach, both m, world.

    The reach is the largest distance of the point from there within the joints' limits, by ascent from some postures;
    0 if every origin moves, as on a mobile base.

    Parameters
    ----------
    robot : RobotModel
    link : int
    p_LC : (3,) array
        Point in its frame (m).
    """
    postures = postures_within(robot, np.random.default_rng(0), STARTS)
    origins = np.array([robot.kinematics(q).p_WL[: link + 1] for q in postures])
    still = np.flatnonzero(np.ptp(origins, axis=0).max(axis=1) < 1e-9)
    if len(still) == 0:
        return np.zeros(3), 0.0
    shoulder, farthest = origins[0, still[-1]], 0.0
    for q in postures:
        for _ in range(STEPS):
            p_WC, _, J, _ = robot.kinematics(q).point(link, p_LC)
            away = p_WC - shoulder
            distance = float(np.linalg.norm(away))
            farthest = max(farthest, distance)
            if distance > 0.0:
                q = np.clip(q + J.T @ away / max(distance, farthest) ** 2, robot.q_min, robot.q_max)
    return shoulder, farthest
