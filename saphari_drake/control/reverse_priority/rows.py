"""The rows of a priority stack as arrays, for compiled laws: one for each scalar component of a task or bound."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.reverse_priority.tasks import Bound, Component, Kind, Task
from saphari_drake.errors import ParameterError
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class Table(NamedTuple):
    """Constants of all rows; the first seven are those of a `Component`, the sign is −1 for a lower bound."""

    kind: NDArray[np.int64]
    link: NDArray[np.int64]
    p_LC: Array  # (r, 3)
    number: NDArray[np.int64]  # `index` of the component
    direction: Array  # (r, 3)
    length: Array
    R_LF: Array  # (r, 9)
    sign: Array
    gain: Array
    buffer: Array
    velocity_buffer: Array
    task: NDArray[np.int64]  # whose reference the row follows; −1: a constraint
    column: NDArray[np.int64]  # where in it the desired value and velocity are
    rate_column: NDArray[np.int64]


def row(component: Component, sign: float, owner: Bound | Task | None, reference: Sequence[int] = (-1, 0, 0)) -> tuple:
    """Return a row of the table: a component, and the bound or task that it belongs to."""
    c, gain = component, owner.gain if owner else 0.0
    buffers = (owner.buffer, owner.velocity_buffer) if isinstance(owner, Bound) else (1.0, 1.0)
    return (c.kind, c.link, c.p_LC, c.index, c.direction, c.length, c.R_LF, sign, gain, *buffers, *reference)


def table(robot: RobotModel, rows: Sequence[tuple]) -> Table:
    """Return rows as arrays; `ParameterError` for a link, joint or axis that the robot does not have."""
    most = {Kind.JOINT: robot.n, Kind.TURN: 3}
    for kind, link, _, index, *_ in rows:
        if not (-1 <= link < robot.n and 0 <= index < most.get(kind, index + 1)):
            raise ParameterError("levels", f"{robot.name} has no link {link}, or no {Kind(kind).name.lower()} {index}")
    return Table(*(np.array(column) for column in zip(*rows)))
