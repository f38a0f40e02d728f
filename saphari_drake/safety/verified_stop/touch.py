"""Down to which share of a velocity a touch is soft; compiled."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.tree import tree_dynamics, tree_kinematics
from saphari_drake.safety.nearness import Balls, Surface
from saphari_drake.safety.power_force.law import Rule, contact_scale


class Touch(NamedTuple):
    """Whom the robot may touch, and how softly."""

    surface: Surface
    rule: Rule  # its reach does not count
    people: Balls  # where they were seen, without heads
    which: NDArray[np.int64]  # their numbers among the surroundings


@njit(cache=True)
def soft_shares(tree, touch, q, v, count, reach):
    """Return the share (count,) of v (n,) down to which no touch of a ball is harder than allowed, 0: any is.

    As `contact_scale` has it, at q and with all who may be touched within `reach` (m): the hardest touch counts.
    """
    shares = np.zeros(count)
    if touch.which.shape[0] > 0:
        motion = tree_kinematics(tree, q, v)
        M, _, _, _, _ = tree_dynamics(tree, motion, v)
        nobody = np.zeros(touch.which.shape[0], dtype=np.bool_)
        r = touch.rule
        rule = Rule(r.limits, r.walls, reach, r.gap, r.thickest, r.still)
        found = contact_scale(touch.surface, motion, M, v, touch.people, nobody, rule)
        for k in touch.which:
            shares[k] = found[0]
    return shares
