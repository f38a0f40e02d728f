"""Who touches, which point was touched first, and what that leads to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.hand_guiding.parameters import GuidedPointParameters
from saphari_drake.messages import Immutable

Array = NDArray[np.float64]


class GuidingPriority(IntEnum):
    """Which guided point is the main task, also published as a number."""

    NONE = 0  # nobody touches
    END_EFFECTOR = 1
    BODY = 2


class GuidingStatus(IntEnum):
    """What hand guiding does, also published as a number."""

    HOLD = 0  # nobody touches: keep the posture
    GUIDED = 1  # every touched point follows its hand
    PARTIAL = 2  # a touched point cannot move in some direction that it is pushed in
    LIMITED = 3  # a limit of speed, workspace or joints holds the motion back
    SENSOR_LOST = 4  # a force, or the joint state, is not known: brake, then keep the posture
    WAITING = 5  # all is known again: keep the posture until nobody touches


class HandForces(NamedTuple):
    """What the sensors say of the hands in one cycle."""

    force: Array  # (2, 3) F_e, F_b, N, world; zero while not known
    torque: Array  # (n,) J_eᵀF_e + J_bᵀF_b
    link: int  # link touched on the body, −1: none
    p_LC: Array  # (3,) force-weighted contact point, m, link frame
    known: bool


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

    @property
    def order(self) -> tuple[int, ...]:
        """The touched points, the main one first; 0: end effector, 1: body."""
        order = (1, 0) if self.priority == GuidingPriority.BODY else (0, 1)
        return tuple(c for c in order if self.touched[c])

    def same_law(self, other: Touches) -> bool:
        """Whether the same points are guided with the same priority."""
        return (self.touched, self.priority, self.ready) == (other.touched, other.priority, other.ready)


def next_touches(
    before: Touches,
    hands: HandForces,
    points: tuple[GuidedPointParameters, GuidedPointParameters],
    release_time: float,
    period: float,
) -> Touches:
    """Return who touches, and the main point: the one touched first, until it is let go.

    A touch begins above the upper threshold and ends when the force has stayed below the lower one for
    `release_time` (s): the force of a hand that turns round is small for a moment.
    """
    if not hands.known:
        return Touches()
    F_e, F_b = hands.force
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
    main = before.priority
    if main == GuidingPriority.NONE and e and b:
        # Both in one cycle: the one pressed harder, measured by its threshold.
        harder = sizes[1] / points[1].touch_on > sizes[0] / points[0].touch_on
        main = GuidingPriority.BODY if harder else GuidingPriority.END_EFFECTOR
    elif not {GuidingPriority.END_EFFECTOR: e, GuidingPriority.BODY: b}.get(main, False):
        main = GuidingPriority.END_EFFECTOR if e else GuidingPriority.BODY if b else GuidingPriority.NONE
    return Touches((e, b), main, True, below)
