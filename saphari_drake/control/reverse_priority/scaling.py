"""Velocity and acceleration limits of a priority stack: what the tasks ask for is scaled, what constraints ask for not.

Velocities v_j may differ from those before by a_j T at most. The tasks are scaled until the result keeps both limits.
An arm that moves may not be able to stop as soon as the scale 0 asks for. Then v = v_before + σ (v* − v_before), with
v* as the velocity limits alone leave it and the largest σ ≤ 1 that the accelerations allow. Where v_before and v* keep
a constraint J v ≤ ẋ*, so does v: its buffer has to be as wide as the arm takes to slow down.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.control.reverse_priority.law import Array, Levels, PriorityStatus, Rows, Settings, add_levels
from saphari_drake.math.products import apply

_SCALE_STEPS = 14
_HELD = 1e-3  # share of the velocity a row can have at all, by which a constraint may be missed


class Change(NamedTuple):
    """How far the velocity may move in one cycle."""

    before: Array  # (n,) velocity of the cycle before
    most: Array  # (n,) largest change; infinite: any


@njit(cache=True)
def _share(v, v_max):
    """Return the largest |v_j|/v_max_j."""
    return np.max(np.abs(v) / v_max)


@njit(cache=True)
def _both(v, v_max, change):
    """Return the largest share of a velocity or acceleration limit."""
    return max(_share(v, v_max), _share(v - change.before, change.most))


@njit(cache=True)
def _checked(status, rows, count, v, v_max):
    """Return INFEASIBLE if one of the first `count` rows, at or beyond its bound, does not keep ẋ ≤ ẋ*, or `status`."""
    rates = apply(rows.J, v) + rows.own
    for i in range(count):
        excess = rates[i] - rows.wanted[i]
        if rows.x[i] >= rows.goal[i] and excess > _HELD * np.sum(np.abs(rows.J[i]) * v_max):
            return PriorityStatus.INFEASIBLE.value
    return status


@njit(cache=True)
def solve_stack(levels: Levels, rows: Rows, v_start: Array, settings: Settings, change: Change):
    """Return the joint velocity of a stack, within the velocity and acceleration limits.

    What the levels up to the highest task ask for is scaled as a whole until the result, with the constraints above
    them, keeps the limits. Should the constraints on top alone ask for more than the velocity limits, that is scaled
    instead (LIMITED): the arm then goes the right way, as fast as it can. See above for accelerations (LATE).

    Parameters
    ----------
    v_start : (n,) array
        Velocity below all levels, eq. (27).

    Returns
    -------
    v (n,), h (r,), scale, status
        Command, activations (1 for tasks), factor on the tasks, and `PriorityStatus`.
    """
    v, h, top, v_max = v_start.copy(), np.zeros(rows.x.shape[0]), levels.top, settings.v_max
    W = settings.damping**2 * np.eye(v.shape[0])
    add_levels(levels, top, levels.ends.shape[0], rows, settings, W, v, h)
    result = v.copy()
    add_levels(levels, 0, top, rows, settings, W.copy(), result, h)
    hard = levels.ends[top - 1] if top > 0 else 0
    if _both(result, v_max, change) <= 1.0:
        return result, h, 1.0, _checked(PriorityStatus.OK.value, rows, hard, result, v_max)
    alone, none = np.zeros_like(v), Change(change.before, np.full(v.shape[0], np.inf))
    add_levels(levels, 0, top, rows, settings, W.copy(), alone, h)
    if _share(alone, v_max) > 1.0:
        return _reached(alone / _share(alone, v_max), h, 0.0, PriorityStatus.LIMITED.value, change)
    if _both(alone, v_max, change) <= 1.0:
        none = change
    elif _share(result, v_max) <= 1.0:
        result[:] = v
        add_levels(levels, 0, top, rows, settings, W.copy(), result, h)
        return _reached(result, h, 1.0, PriorityStatus.LATE.value, change)
    low, high, trial = 0.0, 1.0, v.copy()
    result[:] = alone
    for _ in range(_SCALE_STEPS):
        middle = 0.5 * (low + high)
        trial[:] = middle * v
        add_levels(levels, 0, top, rows, settings, W.copy(), trial, h)
        if _both(trial, v_max, none) <= 1.0:
            low = middle
            result[:] = trial
        else:
            high = middle
    status = _checked(PriorityStatus.SCALED.value, rows, hard, result, v_max)
    return _reached(result, h, low, status, change)


@njit(cache=True)
def _reached(v, h, scale, status, change):
    """Return the result with v as near as one cycle comes to it from the velocity before."""
    share = _share(v - change.before, change.most)
    if share > 1.0:
        v, status = change.before + (v - change.before) / share, PriorityStatus.LATE.value
    return v, h, scale, status
