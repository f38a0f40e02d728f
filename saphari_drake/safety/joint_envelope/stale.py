"""Whether a command comes from a controller that is dead; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit

Array = NDArray[np.float64]


class Repeated(NamedTuple):
    """A command, the measured state that came with it, and for how long (s) it was the same while the state changed.

    A controller that lives answers what it measures: bit for bit the same command again and again, while positions or
    velocities change, comes from none. Where nothing changes, nothing is known.
    """

    command: Array  # (n,)
    state: Array  # (2n,) positions and velocities
    time: float
    q_hold: Array  # (n,) positions held since it was stale; NaN: it is not


@njit(cache=True)
def same(command: Array, other: Array) -> bool:
    """Return whether two commands (n,) are the same bit for bit, both unknown included."""
    for i in range(len(command)):
        if command[i] != other[i] and not (np.isnan(command[i]) and np.isnan(other[i])):
            return False
    return True


@njit(cache=True)
def after(known: Repeated, command: Array, state: Array, period: float, stale_time: float) -> Repeated:
    """Return what is known one period later, with a command (n,) and the state (2n,) that came with it."""
    n = len(command)
    if not same(command, known.command):
        return Repeated(command.copy(), state.copy(), 0.0, np.full(n, np.nan))
    time, finite = known.time, True
    for i in range(n):
        finite = finite and np.isfinite(command[i])
    for i in range(2 * n):
        if state[i] != known.state[i]:
            time += period
            break
    if not (time >= stale_time or not finite):
        return Repeated(known.command, state.copy(), time, np.full(n, np.nan))
    return Repeated(known.command, state.copy(), time, state[:n].copy() if np.isnan(known.q_hold[0]) else known.q_hold)
