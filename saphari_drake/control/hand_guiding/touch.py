"""What the hands do: forces at both points in the world, who touches, and which point was touched first."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.hand_guiding.law import contact_torque
from saphari_drake.control.hand_guiding.parameters import GuidedPointParameters
from saphari_drake.messages import GuidingPriority, Immutable, SkinReading, SkinStatus
from saphari_drake.robots.dynamics import DynamicsTerms
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class Tip(NamedTuple):
    """The guided point of the end effector."""

    link: int
    p_LC: Array  # (3,) m, link frame


class Sensed(NamedTuple):
    """What the sensors say in one cycle."""

    force: Array  # (2, 3) F_e, F_b, N, world
    torque: Array  # (n,) J_eᵀF_e + J_bᵀF_b
    link: int  # link touched on the body, −1: none
    p_LC: Array  # (3,) force-weighted contact point, m, link frame
    valid: bool


def joints_that_move(robot: RobotModel) -> Array:
    """Return for each link (row) 1.0 at the joints that move it (n, n)."""
    moved_by = np.zeros((robot.n, robot.n))
    for link in range(robot.n):
        joint = link
        while joint >= 0:
            moved_by[link, joint] = 1.0
            joint = int(robot.tree.parent[joint])
    return moved_by


def sense(
    terms: DynamicsTerms,
    reading: SkinReading,
    wrench: Array,
    tip: Tip,
    moved_by: Array,
    age: float,
    timeout: float,
) -> Sensed:
    """Return the forces of the hands on both points; invalid, and zero, if a sensor does not know its force.

    Contacts on the link of the strongest one act together, at their force-weighted centroid. The moment at the wrist is
    not used, as in (47): about the last joint the sensor feels the whole inertia that it turns, and a torque that
    answered it would answer itself.

    Parameters
    ----------
    terms : DynamicsTerms
    reading : SkinReading
    wrench : (6,) array
        Moment (Nm) and force (N) of the person on the robot at the tip, world axes.
    tip : Tip
    moved_by : (n, n) array
        See `joints_that_move`.
    age, timeout : float
        Age of the reading and the largest one allowed (s).
    """
    force, point, contacts = np.zeros((2, 3)), np.zeros(3), reading.contacts
    # A sum is finite if all its terms are.
    total = float(wrench.sum()) + sum(float(c.f_L.sum() + c.p_LC.sum()) for c in contacts)
    if reading.status == SkinStatus.LOST or age > timeout or not math.isfinite(total):
        return Sensed(force, np.zeros(len(terms.q)), -1, point, False)
    force[0] = wrench[3:]
    p_tip = terms.p_WL[tip.link] + terms.R_WL[tip.link] @ tip.p_LC
    torque = contact_torque(terms.S, moved_by[tip.link], p_tip, wrench[3:])
    weight = 0.0
    for contact in contacts:
        link = contact.link
        f_W = terms.R_WL[link] @ contact.f_L
        p_WC = terms.p_WL[link] + terms.R_WL[link] @ contact.p_LC
        torque += contact_torque(terms.S, moved_by[link], p_WC, f_W)
        if link == contacts[0].link:
            size = math.sqrt(f_W @ f_W)
            force[1] += f_W
            point += size * contact.p_LC
            weight += size
    if weight > 0.0:
        point /= weight
    return Sensed(force, torque, contacts[0].link if weight > 0.0 else -1, point, True)


@dataclass(frozen=True)
class Touches(Immutable):
    """Who touches.

    Attributes
    ----------
    touched : (bool, bool)
        End effector and body.
    priority : GuidingPriority
    ready : bool
        Whether guiding is allowed: after the start and after a fault, not before nobody touches.
    below : (float, float)
        How long their forces have been below the lower threshold (s).
    """

    touched: tuple[bool, bool] = (False, False)
    priority: GuidingPriority = GuidingPriority.NONE
    ready: bool = False
    below: tuple[float, float] = (0.0, 0.0)

    def same_law(self, other: Touches) -> bool:
        """Whether the same points are guided with the same priority."""
        return self.touched == other.touched and self.priority == other.priority and self.ready == other.ready


def next_touches(
    before: Touches,
    sensed: Sensed,
    points: tuple[GuidedPointParameters, GuidedPointParameters],
    release_time: float,
    period: float,
) -> Touches:
    """Return who touches, and the main point: the one touched first, until it is let go.

    A touch begins above the upper threshold and ends when the force has stayed below the lower one for
    `release_time` (s): the force of a hand that turns round is small for a moment.
    """
    if not sensed.valid:
        return Touches()
    F_e, F_b = sensed.force
    sizes = math.sqrt(F_e @ F_e), math.sqrt(F_b @ F_b)
    low = tuple(size < point.touch_off for size, point in zip(sizes, points))
    if not before.ready:
        return Touches(ready=all(low))
    e_below, b_below = (time + period if is_low else 0.0 for time, is_low in zip(before.below, low))
    below = e_below, b_below
    e, b = (
        time < release_time if was else size > point.touch_on
        for size, point, was, time in zip(sizes, points, before.touched, below)
    )
    if not (e or b):
        return Touches(ready=True, below=below)
    main = before.priority
    if main == GuidingPriority.NONE and e and b:
        # Both in one cycle: the one pressed harder, measured by its threshold.
        harder = sizes[1] / points[1].touch_on > sizes[0] / points[0].touch_on
        main = GuidingPriority.BODY if harder else GuidingPriority.END_EFFECTOR
    elif main == GuidingPriority.NONE or not (e, b)[main - 1]:
        main = GuidingPriority.END_EFFECTOR if e else GuidingPriority.BODY
    return Touches((e, b), main, True, below)
