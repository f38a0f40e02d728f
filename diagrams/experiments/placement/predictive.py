"""Fits the predictive control of a manipulator to another arm: obstacles that are in its way, but not in it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.nmpc.jobs import point_positions
from experiments.nmpc.manipulator import points_along
from experiments.placement.arm import PlacedArm, placed_arm
from saphari_drake.control.nmpc.parameters import TestPoint
from saphari_drake.errors import ModelError
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Points = tuple[TestPoint, ...]
ROOM = 0.03  # m; obstacles are so much farther than d_min from the arm at the start, and where it can be at the end
NEAR = (0.08, 0.11, 0.14, 0.17, 0.19)  # m; how near the arm would come to an obstacle
TURNS = (90.0, 120.0)  # deg; larger turns to the goal where the first one leaves no room
STEP, TURN = 0.03, 1.5  # rad; steps of a self-motion, and how far it goes


def place_job(scenario: Any, robot: RobotModel) -> None:
    """Fit a `ManipulatorScenario`: posture, tip, test points along the chain, and two obstacles.

    The first is beside the arm's middle at the goal, on the side from which its self-motion leads away with the pose
    kept; an arm without self-motion, or room, gets it beside its way. The second is above the way.

    Raises
    ------
    ModelError
        If no such places are found.
    """
    arm, job = placed_arm(robot), scenario.job
    tip = robot.link_names[arm.chain.tip]
    job.start_deg, job.end_effector, job.published_points = arm.home_deg, tip, False
    start, first = arm.robot.home, None
    points = points_along(robot, tip, job.d_min, job.c, published=False)
    for turn in np.deg2rad([job.turn_deg, *TURNS]):
        goal = start.copy()
        goal[0] += turn if start[0] + turn < robot.q_max[0] else -turn
        places = itertools.chain(*(find(arm, points, start, goal, job.d_min) for find in (_beside_goal, _beside_way)))
        first = next(places, None)
        if first is not None:
            break
    else:
        raise ModelError(f"{robot.name}: no obstacle found {job.d_min} m clear of start and goal, and in its way")
    job.goal_deg = np.rad2deg(goal).tolist()
    halfway = _at(robot, points, 0.5 * (start + goal))
    above = halfway[len(points) // 2 + 1] + [0.0, 0.0, 0.3]
    job.obstacles = [first.tolist()]
    if all(_clear(_at(robot, points, q), above, job.d_min) for q in (start, goal)):
        job.obstacles.append(above.tolist())


def _at(robot: RobotModel, points: Points, q: Array) -> Array:
    return point_positions(robot, points, evaluate_dynamics(robot, q, np.zeros(robot.n)))


def _clear(p_WC: Array, obstacle: Array, d_min: float) -> bool:
    return bool(np.linalg.norm(p_WC - obstacle, axis=1).min() > d_min + ROOM)


def _beside_goal(arm: PlacedArm, points: Points, start: Array, goal: Array, d_min: float) -> Iterator[Array]:
    """Obstacles that are too near at the goal and that a self-motion there gets away from, the nearest first."""
    robot = arm.robot
    at_start, at_goal = _at(robot, points, start), _at(robot, points, goal)
    ways = [_self_motion(arm, goal, side) for side in (1.0, -1.0)]
    places = [np.array([_at(robot, points, q) for q in way]) for way in ways]
    for near in NEAR:
        for away in (way for way in places if len(way) > 1):
            moves = at_goal - away[1]
            order = np.argsort(np.linalg.norm(moves, axis=1))[::-1]
            for m in order[:2]:
                size = float(np.linalg.norm(moves[m]))
                if size < 1e-4:
                    continue
                obstacle = at_goal[m] + near * moves[m] / size
                if _clear(at_start, obstacle, d_min) and any(_clear(p, obstacle, d_min) for p in away):
                    yield obstacle


def _self_motion(arm: PlacedArm, goal: Array, side: float) -> list[Array]:
    """Postures from the goal on that keep the pose of the tip, to one side; the goal alone if there is none."""
    robot, q, way, last = arm.robot, goal.copy(), [goal], None
    target = robot.kinematics(goal)
    for _ in range(int(TURN / STEP)):
        at = robot.kinematics(q)
        J = np.vstack([at.S[:, :3].T, at.point(arm.chain.tip, np.zeros(3)).Jv_WC])
        if robot.n == 6:
            return way
        n = np.linalg.svd(J)[2][6]
        n = n * (side if last is None else np.sign(n @ last))
        last = n
        R = target.R_WL[-1] @ at.R_WL[-1].T
        turned = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        error = np.concatenate([turned, target.p_WL[-1] - at.p_WL[-1]])
        q = q + STEP * n + np.linalg.pinv(J, rcond=1e-2) @ error
        if np.any(q < robot.q_min + 0.1) or np.any(q > robot.q_max - 0.1):
            return way
        way.append(q.copy())
    return way


def _beside_way(arm: PlacedArm, points: Points, start: Array, goal: Array, d_min: float) -> Iterator[Array]:
    """Obstacles clear of start and goal that the straight way comes too near to, the nearest first."""
    robot = arm.robot
    at_start, at_goal, half = (_at(robot, points, q) for q in (start, goal, 0.5 * (start + goal)))
    out = half[-1] - arm.terms.p_WL[0]
    out = np.array([out[0], out[1], 0.0]) / max(float(np.hypot(out[0], out[1])), 1e-9)
    for near in NEAR:
        for up in (0.0, 0.5, -0.5, 1.0, 2.0, -1.0):
            direction = out + np.array([0.0, 0.0, up])
            obstacle = half[-1] + near * direction / np.linalg.norm(direction)
            if _clear(at_start, obstacle, d_min) and _clear(at_goal, obstacle, d_min):
                yield obstacle
