"""The parts of an arm by their place in its chain, from its geometry alone: shoulder, elbow, wrist and tip."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ModelError
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class ArmChain(NamedTuple):
    """Indices of links (and of the joints that move them), and a length.

    Attributes
    ----------
    shoulder : int
        Second joint: where the arm begins to lean.
    elbow : int
        Joint that folds the arm; its link is the forearm, the one before it the end of the upper arm.
    wrist : int
        Joint before the last one, about which the tip turns.
    tip : int
        Last joint.
    reach : float
        Longest possible distance of the wrist from the shoulder, along the joints (m).
    """

    shoulder: int
    elbow: int
    wrist: int
    tip: int
    reach: float

    @property
    def upper_arm(self) -> int:
        """Link whose far end is the elbow."""
        return self.elbow - 1

    @property
    def forearm(self) -> int:
        """Link that the elbow moves."""
        return self.elbow

    def links(self, robot: RobotModel, first: int) -> list[int]:
        """Return the links from `first` to the wrist that have a surface to be touched."""
        return [link for link in range(first, self.wrist + 1) if np.any(robot.shapes.link == link)]


def arm_chain(robot: RobotModel) -> ArmChain:
    """Return the parts of a fixed-base arm of six revolute joints or more, one after the other.

    The elbow is the joint, between shoulder and wrist, that changes the distance of these two the most.

    Raises
    ------
    ModelError
        If the robot is no such arm.
    """
    tree, n = robot.tree, robot.n
    if n < 6:
        raise ModelError(f"{robot.name}: has {n} joints; an arm of six or more is needed")
    if np.any(tree.kind != REVOLUTE):
        names = [name for name, kind in zip(robot.joint_names, tree.kind) if kind != REVOLUTE]
        raise ModelError(f"{robot.name}: an arm of revolute joints is needed; not revolute: {', '.join(names)}")
    if np.any(np.asarray(tree.parent) != np.arange(-1, n - 1)):
        raise ModelError(f"{robot.name}: its joints branch; one chain is needed")
    shoulder, wrist = 1, n - 2
    postures = postures_within(robot, np.random.default_rng(0), 50)
    change = np.zeros(n)
    for q in postures:
        at = robot.kinematics(q)
        away = at.p_WL[wrist] - at.p_WL[shoulder]
        change += np.abs(away @ at.point(wrist, np.zeros(3)).Jv_WC) / max(float(np.linalg.norm(away)), 1e-6)
    elbow = shoulder + 1 + int(np.argmax(change[shoulder + 1 : wrist]))
    lengths = np.linalg.norm(tree.p_PF, axis=1)
    return ArmChain(shoulder, elbow, wrist, n - 1, float(lengths[shoulder + 1 : wrist + 1].sum()))


def middle_range(robot: RobotModel, share: float = 0.8) -> tuple[Array, Array]:
    """Return lower and upper end (n,) of the middle share of each joint's range; of a full turn where it is wider."""
    low, high = np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi)
    apart = low >= high  # a range beyond a half turn from zero
    low, high = np.where(apart, robot.q_min, low), np.where(apart, robot.q_max, high)
    middle, half = 0.5 * (low + high), 0.5 * share * (high - low)
    return middle - half, middle + half


def postures_within(robot: RobotModel, rng: np.random.Generator, count: int) -> Array:
    """Return random postures (count, n) of the middle of the joints' ranges."""
    low, high = middle_range(robot)
    return rng.uniform(low, high, (count, robot.n))
