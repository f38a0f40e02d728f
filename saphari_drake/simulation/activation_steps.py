"""What the entry and the release of a unilateral constraint do to the command: the bound of its own activation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AROUND = 5  # cycles before and after an event that show the motion's own steps


def switch_step_shares(activation: Array, velocity: Array) -> Array:
    """Return, for each entry or release of a constraint, the velocity step as a share of the activation's own bound.

    A constraint adds h·(a velocity of the size of q̇) to the command. Where its h leaves or reaches 0 between two
    cycles, it therefore adds no more than |Δh|·max|q̇| to the step that the motion makes anyway, which the cycles
    around it show. A stack that switches rows on and off would step by the whole of max|q̇|.

    Parameters
    ----------
    activation : (T, c) array
        h of each constraint at each cycle.
    velocity : (T, n) array
        Joint velocity command at each cycle.

    Returns
    -------
    (e,) array
        Largest joint step over its bound |Δh|·max|q̇| + (largest step of the five cycles before and after), by event.
    """
    steps = np.abs(np.diff(velocity, axis=0)).max(axis=1, initial=0.0)
    jumps = np.abs(np.diff(activation, axis=0)).max(axis=1, initial=0.0)
    on = activation > 0.0
    events = 1 + np.flatnonzero((on[2:-1] != on[1:-2]).any(axis=1))
    near = np.r_[-AROUND:0, 1 : AROUND + 1]
    around = steps[np.clip(events[:, None] + near, 0, len(steps) - 1)].max(axis=1, initial=0.0)
    size = np.maximum(np.abs(velocity[events]).max(axis=1), np.abs(velocity[events + 1]).max(axis=1))
    bound = jumps[events] * size + around
    return steps[events] / np.maximum(bound, np.finfo(float).tiny)
