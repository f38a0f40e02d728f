"""A home posture for an arm whose model file has none: bent, able to move every way, clear of itself and the floor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ModelError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.robots.chain import ArmChain, arm_chain, middle_range
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
DRAWN, KEPT, STEPS = 2500, 12, 120
LOAD = 0.6  # share of the torque limits that gravity may take
FLOOR, APART = 0.12, 0.02  # m; least height of elbow to tip, least distance of links that are no neighbours
TIP = (0.45, 0.85)  # shares of the reach, of the tip's distance from the shoulder
SWIVEL = 0.13  # share of the reach; more motion of the elbow for a unit motion of the joints is no better


def bent_home(robot: RobotModel, floor: float = FLOOR) -> Array:
    """Return a home posture (n,), rad: the best of random ones, each improved in small steps; the same at each call.

    Better is: a larger least singular value of the tip's Jacobian (6 × n, lengths in reaches), joints farther from
    their limits, the elbow free to move while the tip stays, and above it, joints that turn less. The tip is ahead of
    the base, in the plane y = 0, where the first joint's axis is vertical. No link from the elbow on is lower than
    `floor` (m).

    Raises
    ------
    ModelError
        If the robot is no fixed-base arm (`arm_chain`), or no posture keeps what is asked of it.
    """
    chain, rng = arm_chain(robot), np.random.default_rng(0)
    low, high = middle_range(robot)
    drawn = np.array([_ahead(robot, chain, q) for q in rng.uniform(low, high, (DRAWN, robot.n))])
    scores = np.array([_score(robot, chain, q, floor) for q in drawn])
    better = []
    for q in drawn[np.argsort(scores)[::-1][:KEPT]]:
        best = _score(robot, chain, q, floor)
        for k in range(STEPS):
            other = _ahead(robot, chain, np.clip(q + 0.3 * 0.97**k * rng.normal(size=robot.n), low, high))
            score = _score(robot, chain, other, floor)
            q, best = (other, score) if score > best else (q, best)
        if np.isfinite(best):
            better.append((best, q))
    for _, q in sorted(better, key=lambda pair: -pair[0]):
        if clear_of_itself(robot, q):
            return q
    raise ModelError(f"{robot.name}: no home posture found within its limits of position and torque; give one")


def is_home(robot: RobotModel) -> bool:
    """Return whether the robot has a home of its own: not zero for each joint, or the middle where zero is outside."""
    with np.errstate(invalid="ignore"):
        middle = 0.5 * (robot.q_min + robot.q_max)
    bare = np.where((robot.q_min <= 0.0) & (robot.q_max >= 0.0), 0.0, middle)
    return not np.allclose(robot.home, bare)


def clear_of_itself(robot: RobotModel, q: Array, apart: float = APART) -> bool:
    """Return whether links that are no neighbours are so far apart (m), and none but the first is in the floor."""
    shapes = robot.shapes
    at = robot.kinematics(q)
    R_WS, p_WS = shapes.in_world(at.R_WL, at.p_WL)
    for s in range(shapes.count):
        link, size = int(shapes.link[s]), shapes.size[s]
        radius = float(size[0] if size[2] == 0.0 else max(size))
        half = float(size[1] if size[2] == 0.0 else 0.0)
        others = np.abs(shapes.link - link) > 2
        for share in np.linspace(-1.0, 1.0, 5):
            p = p_WS[s] + share * half * R_WS[s][:, 2]
            if link >= 1 and p[2] < radius:
                return False
            if others.any() and _distance(robot, R_WS, p_WS, others, p) - radius < apart:
                return False
    return True


def _distance(robot: RobotModel, R_WS: Array, p_WS: Array, chosen: NDArray[np.bool_], p: Array) -> float:
    shapes = robot.shapes
    return float(nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, chosen, p)[1])


def _score(robot: RobotModel, chain: ArmChain, q: Array, floor: float) -> float:
    terms = evaluate_dynamics(robot, q, np.zeros(robot.n))
    p, tip = terms.p_WL, terms.p_WL[chain.tip]
    away = float(np.linalg.norm(tip - p[chain.shoulder])) / chain.reach
    if not TIP[0] < away < TIP[1] or p[chain.elbow :, 2].min() < floor:
        return -np.inf
    ahead = not _upright(terms.S) or (tip[0] > p[0, 0] and abs(tip[1] - p[0, 1]) < 0.01)
    if not ahead or np.any(np.abs(terms.g) > LOAD * robot.tau_max):
        return -np.inf
    J = np.vstack([terms.point(chain.tip, np.zeros(3)).Jv_WC / chain.reach, (terms.S[:, :3]).T])
    low, high = middle_range(robot, 1.0)
    margin = float((np.minimum(q - low, high - q) / (high - low)).min())
    _, sigma, V = np.linalg.svd(J)
    # How far the elbow goes, of the reach, a unit motion of the joints that leaves the tip where it is.
    swivel = terms.point(chain.elbow, np.zeros(3)).Jv_WC @ V[6:].T / chain.reach
    aside = float(np.linalg.norm(swivel, 2)) if swivel.size else 0.0
    up = float(p[chain.elbow, 2] - tip[2]) / chain.reach
    bent = 0.06 * float(np.abs(q[1:]).mean())
    return float(sigma[5]) + 2.0 * min(aside, SWIVEL) + 0.5 * min(margin, 0.2) + 0.15 * min(up, 0.3) - bent


def _upright(S: Array) -> bool:
    return bool(abs(S[0, 2]) > 0.99)


def _ahead(robot: RobotModel, chain: ArmChain, q: Array) -> Array:
    """Turn the first joint so that the tip is ahead, if its axis is vertical and its range allows it."""
    at = robot.kinematics(q)
    tip = at.p_WL[chain.tip] - at.p_WL[0]
    if not _upright(at.S):
        return q
    turned = q.copy()
    turned[0] -= np.sign(at.S[0, 2]) * np.arctan2(tip[1], tip[0])
    turned[0] = (turned[0] + np.pi) % (2.0 * np.pi) - np.pi
    low, high = middle_range(robot)
    return turned if low[0] <= turned[0] <= high[0] else q
