"""A priority stack made ready for one robot: its levels as tables, evaluated and solved in compiled passes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.compiled import njit
from saphari_drake.control.reverse_priority.components import (
    feature,
    feature_table,
    point_rows,
    rotation_error,
    world_point,
)
from saphari_drake.control.reverse_priority.solver import CONSTRAINTS, TASK, solve_stack
from saphari_drake.control.reverse_priority.tasks import Bound, Component, FrameTask, Level, ScalarTask, Task
from saphari_drake.errors import ModelError, ParameterError, StateError
from saphari_drake.math.products import product
from saphari_drake.math.tree import tree_kinematics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]

REFERENCE_SIZE = 18  # rotation row by row, position, angular and linear velocity
_FRAME, _SCALAR = 0, 1


class StackResult(NamedTuple):
    """Outcome of one pass."""

    v: Array  # (n,) joint velocity
    activation: Array  # (c,) h of each constraint
    error: Array  # (t,) of each task row
    scale: float  # factor on the tasks
    status: int  # 0 as asked, 1 tasks scaled, 2 constraints need more than the velocity limits
    x: Array  # (c,) values of the constraints, upper bounds positive, lower ones as −x_C
    J_tasks: Array  # (t, n) rows of all tasks


class _Table(NamedTuple):
    kinds: NDArray[np.int64]
    links: NDArray[np.int64]
    points: Array
    indices: NDArray[np.int64]
    directions: Array
    lengths: Array
    signs: Array


class PriorityStack:
    """Levels from the highest priority to the lowest: a task, or a list of bounds.

    Parameters
    ----------
    robot : RobotModel
    levels : sequence of task or list of Bound
    damping : float
        λ_s, how far the step stays bounded near singular postures (same unit as the task Jacobians).
    task_damping : float
        μ of the tasks.

    Attributes
    ----------
    tasks : list of FrameTask and ScalarTask
    sides : list of (Bound, sign)
        The constraints: +1 for an upper bound, −1 for a lower one; in the order of the activations.
    bounds : (c,) array
        Their bounds, lower ones as −x̄.
    num_targets : int
        How many targets the components refer to.
    """

    def __init__(
        self, robot: RobotModel, levels: Sequence[Level], damping: float = 0.1, task_damping: float = 1.0
    ) -> None:
        if not levels:
            raise ParameterError("levels", "needs at least one task or list of bounds")
        if not np.all(np.isfinite(robot.v_max)):
            raise ModelError(f"{robot.path}: a priority stack needs a velocity limit of every joint")
        if not damping > 0.0 or not task_damping > 0.0:
            raise ParameterError("damping", f"λ_s and μ must be positive, got {damping} and {task_damping}")
        self.robot, self._damping, self._task_damping = robot, float(damping), float(task_damping)
        self.tasks: list[Task] = []
        self.sides: list[tuple[Bound, float]] = []
        kinds, ends_t, ends_c, rows = [], [], [], 0
        for level in levels:
            if isinstance(level, FrameTask | ScalarTask):
                self.tasks.append(level)
                rows += level.size
                kinds.append(TASK)
            else:
                self.sides += [(b, 1.0) for b in level if np.isfinite(b.upper)]
                self.sides += [(b, -1.0) for b in level if np.isfinite(b.lower)]
                kinds.append(CONSTRAINTS)
            ends_t.append(rows)
            ends_c.append(len(self.sides))
        self.rows = rows
        components = [bound.component for bound, _ in self.sides]
        scalar = [task.component for task in self.tasks if isinstance(task, ScalarTask)]
        self.num_targets = 1 + max([c.index for c in components + scalar if c.kind >= 2], default=-1)
        self._table = _table(components, [sign for _, sign in self.sides])
        self.bounds = np.array([b.upper if sign > 0 else -b.lower for b, sign in self.sides])
        self._shape = (np.array(kinds), np.array(ends_t), np.array(ends_c))
        self._buffers = (
            np.array([bound.buffer for bound, _ in self.sides]),
            np.array([bound.velocity_buffer for bound, _ in self.sides]),
            np.array([bound.gain for bound, _ in self.sides]),
        )
        self._task_table = _task_table(self.tasks)

    def solve(
        self,
        q: ArrayLike,
        v_start: ArrayLike,
        references: Array,
        targets: Array,
        period: float,
        bounds: Array | None = None,
    ) -> StackResult:
        """Return the joint velocity of eq. (24)–(32), regularised, at joint positions `q`.

        Parameters
        ----------
        q, v_start : (n,) arrays
            Joint positions, and the velocity below all levels, eq. (27).
        references : (tasks, 18) array
            Of each task: rotation (row by row), position, angular and linear velocity of the frame in the world; of a
            `ScalarTask`: value in the first and velocity in the second place.
        targets : (k, 6) array
            Position and velocity of each target in the world.
        period : float
            Control cycle (s).
        bounds : (c,) array, optional
            Bounds in place of the attribute `bounds`; infinite ones take a constraint out.

        Raises
        ------
        StateError
            If sizes do not fit or something is not finite.
        """
        q, v_start = np.asarray(q, dtype=float), np.asarray(v_start, dtype=float)
        sizes = q.shape, v_start.shape, references.shape, targets.shape[1:]
        wanted = (self.robot.n,), (self.robot.n,), (len(self.tasks), REFERENCE_SIZE), (6,)
        if sizes != wanted or len(targets) < self.num_targets:
            raise StateError(f"positions, velocities, references, targets: sizes {sizes}, needed {wanted}")
        result = StackResult(
            *_solve(
                self.robot.tree, q, self._table, self._task_table, references, targets, self._shape,
                self.bounds if bounds is None else bounds,
                self._buffers, v_start, self.robot.v_max, period, self._damping, self._task_damping, self.rows,
            )
        )  # fmt: skip
        if result.status < 0:
            raise StateError("positions, velocities, references or targets of the priority stack: not finite")
        return result

    def constraints(self, q: Array, targets: Array) -> tuple[Array, Array, Array]:
        """Return values (c,), Jacobian (c, n) and own rates (c,) of the constraints, all as upper bounds."""
        R_WL, p_WL, S, _, _, parent = self.robot.kinematics(q)
        return feature_table(parent, S, R_WL, p_WL, q, *self._table, targets)


def evaluate_component(
    robot: RobotModel, component: Component, q: ArrayLike, targets: Array
) -> tuple[float, Array, float]:
    """Return value, Jacobian (n,) and own rate of a component: ẋ_C = J q̇ + own rate."""
    t, q, row = robot.tree, robot.checked_vector(q, "positions"), np.zeros(robot.n)
    R_WL, p_WL, S, *_ = robot.kinematics(q)
    c = _table([component], [1.0])
    value, own = feature(
        t.parent, S, R_WL, p_WL, q, c.kinds[0], c.links[0], c.points[0], c.indices[0], c.directions[0], c.lengths[0],
        np.atleast_2d(targets), row,
    )  # fmt: skip
    return float(value), row, float(own)


def _table(components: Sequence[Component], signs: Sequence[float]) -> _Table:
    return _Table(
        np.array([c.kind for c in components], dtype=np.int64),
        np.array([c.link for c in components], dtype=np.int64),
        np.array([c.p_LC for c in components], dtype=float).reshape(-1, 3),
        np.array([c.index for c in components], dtype=np.int64),
        np.array([c.direction for c in components], dtype=float).reshape(-1, 3),
        np.array([c.length for c in components], dtype=float),
        np.array(signs, dtype=float),
    )


def _task_table(tasks: Sequence[Task]) -> tuple:
    """Return kind, link, point, rotation, gain, rows (first, count, axes) and scalar component of every task."""
    count = len(tasks)
    kinds, links, gains = np.empty(count, dtype=np.int64), np.zeros(count, dtype=np.int64), np.empty(count)
    points, R_LF = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    axes, sizes = np.zeros((count, 6), dtype=np.int64), np.empty(count, dtype=np.int64)
    nothing = Component("", 0, -1, (0.0,) * 3, 0, (0.0,) * 3, 0.0, "")
    scalar = []
    for i, task in enumerate(tasks):
        gains[i], sizes[i] = task.gain, task.size
        if isinstance(task, FrameTask):
            kinds[i], links[i], points[i] = _FRAME, task.link, task.p_LC
            R_LF[i] = np.reshape(task.R_LF, (3, 3))
            axes[i, : task.size] = task.axes
            scalar.append(nothing)
        else:
            kinds[i] = _SCALAR
            scalar.append(task.component)
    return kinds, links, points, R_LF, gains, axes, sizes, _table(scalar, [1.0] * count)


@njit(cache=True)
def _task_rows(parent, S, R_WL, p_WL, q, table, references, targets, total):
    """Return Jacobian, desired velocity and error of all task rows."""
    kinds, links, points, R_LF, gains, axes, sizes, c = table
    n, first = q.shape[0], 0
    JT, rates, errors = np.zeros((total, n)), np.empty(total), np.empty(total)
    J, full = np.empty((6, n)), np.empty(6)
    for i in range(kinds.shape[0]):
        r = references[i]
        if kinds[i] == _FRAME:
            p_WC = world_point(R_WL, p_WL, links[i], points[i])
            J[:] = 0.0
            point_rows(parent, S, links[i], p_WC, J)
            full[:3] = 0.0
            if axes[i, 0] < 3:
                R = R_LF[i].copy() if links[i] < 0 else product(R_WL[links[i]], R_LF[i])
                full[:3] = rotation_error(R, r[:9].reshape((3, 3)))
            full[3:] = r[9:12] - p_WC
            for k in range(sizes[i]):
                axis = axes[i, k]
                JT[first + k] = J[axis]
                errors[first + k] = full[axis]
                rates[first + k] = r[12 + axis] + gains[i] * full[axis]
        else:
            value, own = feature(
                parent, S, R_WL, p_WL, q, c.kinds[i], c.links[i], c.points[i], c.indices[i], c.directions[i],
                c.lengths[i], targets, JT[first],
            )  # fmt: skip
            errors[first] = r[0] - value
            rates[first] = r[1] - own + gains[i] * errors[first]
        first += sizes[i]
    return JT, rates, errors


@njit(cache=True)
def _solve(
    tree, q, c, task_table, references, targets, shape, bounds, buffers, v_start, v_max, period, lam_s, mu, total
):
    R_WL, p_WL, S, _, _, parent = tree_kinematics(tree, q, np.zeros_like(q))
    x, JC, own = feature_table(
        parent, S, R_WL, p_WL, q, c.kinds, c.links, c.points, c.indices, c.directions, c.lengths, c.signs, targets
    )
    JT, rates, errors = _task_rows(parent, S, R_WL, p_WL, q, task_table, references, targets, total)
    buffer_p, buffer_v, gain = buffers
    if not np.isfinite(q.sum() + v_start.sum() + references.sum() + targets.sum()):
        return v_start, x, errors, 0.0, -1, x, JT
    v, h, scale, status = solve_stack(
        shape[0], shape[1], shape[2], JT, rates, JC, x, own, bounds, buffer_p, buffer_v, gain, v_start, v_max, period,
        lam_s, mu,
    )  # fmt: skip
    return v, h, errors, scale, status, x, JT
