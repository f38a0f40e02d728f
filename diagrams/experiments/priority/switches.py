"""What the entry and the release of a unilateral constraint do to the command, against the activation's own bound."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.reverse_priority.stack import PriorityStack

Array = NDArray[np.float64]


class Switch(NamedTuple):
    """A constraint that entered the command or left it between two cycles."""

    cycle: int  # the one in which it is active
    row: int
    activation: float
    step: float  # rad/s, largest joint velocity that it adds there, and did not before or does not after
    share: float  # of h_i max_j v_max_j, what its activation allows it to add


def find_switches(
    stack: PriorityStack, q: Array, v_start: Array, references: Array, targets: Array, activation: Array, period: float
) -> list[Switch]:
    """Return every entry and release of a constraint along a run.

    The step is the difference between the command and the one without the constraint, solved again. A stack that
    switched rows on and off would show a step of the size of q̇ at any activation.

    Parameters
    ----------
    q, v_start : (T, n) arrays
        Joint positions the controller saw, and the velocities below all levels.
    references : (T, tasks, 18) array
    targets : (T, k, 6) array
    activation : (T, c) array
    period : float
        Control cycle (s).
    """
    on = activation > 0.0
    v_max, switches = float(np.max(stack.robot.v_max)), []
    for k, row in np.argwhere(on[1:] != on[:-1]):
        cycle = k + 1 if on[k + 1, row] else k
        without = stack.bounds.copy()
        without[row] = np.inf
        given = q[cycle], v_start[cycle], references[cycle], targets[cycle], period
        step = float(np.abs(stack.solve(*given).v - stack.solve(*given, bounds=without).v).max())
        h = float(activation[cycle, row])
        switches.append(Switch(int(cycle), int(row), h, step, step / (h * v_max)))
    return switches
