"""Faults of a person: who is faster than assumed, or comes in from outside of the view."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.messages import ObstaclePoints
from saphari_drake.simulation.world.profile import Truth

Array = NDArray[np.float64]
FASTER = 2.0


class Course(NamedTuple):
    """How a person's motion differs at one moment from the one that was meant."""

    time: float  # s, in the motion that was meant
    pace: float
    offset: Array  # (3,) m
    velocity: Array  # (3,) m/s, of the offset


def course(truth: Truth, time: float, away: Sequence[float]) -> Course:
    """Return the course of a person at a time (s), who comes, if from outside, from the direction `away` (world)."""
    pace = FASTER if "person_faster" in truth.faults else 1.0
    if "person_unseen" not in truth.faults:
        return Course(pace * time, pace, np.zeros(3), np.zeros(3))
    sizes, since = truth.sizes, time - truth.faults["person_unseen"]
    direction = np.asarray(away) / np.linalg.norm(away)
    left = sizes.person_distance - sizes.person_speed * max(since, 0.0)
    coming = since >= 0.0 and left > 0.0
    return Course(pace * time, pace, max(left, 0.0) * direction, -sizes.person_speed * direction * coming)


def changed(
    person: Callable[[float], ObstaclePoints], truth: Truth, away: Sequence[float]
) -> Callable[[float], ObstaclePoints]:
    """Return a person's points over time with the faults of `truth`."""
    if not {"person_faster", "person_unseen"} & set(truth.faults):
        return person

    def at(time: float) -> ObstaclePoints:
        now = course(truth, time, away)
        points = person(now.time)
        moved, velocity = np.asarray(points.p_WO) + now.offset, now.pace * np.asarray(points.v_WO) + now.velocity
        return replace(points, p_WO=moved, v_WO=velocity, stamp=time)

    return at
