"""A priority stack made ready for one robot: its levels as a table of scalar rows, evaluated and solved in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.compiled import njit
from saphari_drake.control.reverse_priority.law import Levels, PriorityStatus, Rows, Settings, allowed_rate
from saphari_drake.control.reverse_priority.rows import row, table
from saphari_drake.control.reverse_priority.scaling import Change, solve_stack
from saphari_drake.control.reverse_priority.tasks import (
    Bound,
    Component,
    FrameTask,
    Kind,
    Level,
    ScalarTask,
    Task,
)
from saphari_drake.errors import ModelError, ParameterError, StateError
from saphari_drake.math.products import apply, product
from saphari_drake.math.rotations import are_rotations, rotation_log
from saphari_drake.math.tree import tree_kinematics
from saphari_drake.math.tree_matrices import jacobian, world_point
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
REFERENCE_SIZE = 18  # rotation row by row, position, angular and linear velocity
_NEAR = 1e-9  # m; closer than this a target has no direction


class StackResult(NamedTuple):
    """Outcome of one pass."""

    v: Array  # (n,) joint velocity
    activation: Array  # (c,) h of each constraint
    error: Array  # (t,) of each task row
    scale: float  # factor on the tasks
    status: PriorityStatus
    x: Array  # (c,) values of the constraints, upper bounds positive, lower ones as −x_C
    J_tasks: Array  # (t, n) rows of all tasks


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
        if not np.all(np.isfinite(robot.v_max)):
            raise ModelError(f"{robot.path}: a priority stack needs a velocity limit of every joint")
        if not damping > 0.0 or not task_damping > 0.0:
            raise ParameterError("damping", f"λ_s and μ must be positive, got {damping} and {task_damping}")
        self.robot, self._damping, self._task_damping = robot, float(damping), float(task_damping)
        self.tasks: list[Task] = []
        self.sides: list[tuple[Bound, float]] = []
        rows, ends = [], []
        for level in levels:
            if isinstance(level, FrameTask | ScalarTask):
                rows += [row(c, 1.0, level, (len(self.tasks), *columns)) for c, *columns in level.rows()]
                self.tasks.append(level)
            else:
                sides = [(b, 1.0) for b in level if np.isfinite(b.upper)]
                sides += [(b, -1.0) for b in level if np.isfinite(b.lower)]
                rows += [row(b.component, sign, b) for b, sign in sides]
                self.sides += sides
            ends.append(len(rows))
        if not rows:
            raise ParameterError("levels", "needs at least one task or bound")
        is_task = np.array([isinstance(level, FrameTask | ScalarTask) for level in levels])
        top = int(np.argmax(is_task)) if is_task.any() else len(levels)
        self._levels = Levels(is_task, np.array(ends), top)
        self._table = table(robot, rows)
        self._turning = [k for k, task in enumerate(self.tasks) if isinstance(task, FrameTask) and min(task.axes) < 3]
        self._side_rows, self._task_rows = np.flatnonzero(self._table.task < 0), np.flatnonzero(self._table.task >= 0)
        seen = self._table.number[np.isin(self._table.kind, (Kind.DISTANCE, Kind.VIEW))]
        self.num_targets = 1 + int(np.max(seen, initial=-1))
        self.bounds = np.array([b.upper if sign > 0 else -b.lower for b, sign in self.sides])
        self._goal = np.zeros(len(rows))

    def solve(
        self,
        q: ArrayLike,
        v_start: ArrayLike,
        references: Array,
        targets: Array,
        period: float,
        bounds: Array | None = None,
        change: Change | None = None,
    ) -> StackResult:
        """Return the joint velocity of eq. (24)–(32), regularised, at joint positions `q`.

        If an input or the solution is not finite, velocity and activations are zero and the status is INVALID; errors,
        values and Jacobian are NaN as far as they are not known. Sizes that do not fit raise a `StateError`.

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
        change : Change, optional
            Without it the velocity may change by any amount.
        """
        q, v_start = np.asarray(q, dtype=float), np.asarray(v_start, dtype=float)
        sizes = q.shape, v_start.shape, references.shape, targets.shape[1:]
        wanted = (self.robot.n,), (self.robot.n,), (len(self.tasks), REFERENCE_SIZE), (6,)
        if sizes != wanted or len(targets) < self.num_targets:
            raise StateError(f"positions, velocities, references, targets: sizes {sizes}, needed {wanted}")
        if not are_rotations(references[self._turning, :9].reshape(-1, 3, 3)):
            references = np.full_like(references, np.nan)
        goal, sides, tasks = self._goal.copy(), self._side_rows, self._task_rows
        goal[sides] = self.bounds if bounds is None else bounds
        settings = Settings(self.robot.v_max, float(period), self._damping, self._task_damping)
        change = change or Change(np.zeros(self.robot.n), np.full(self.robot.n, np.inf))
        inputs, limits = (references, targets, goal), (settings, change)
        found = _solve(self.robot.tree, self._levels, self._table, q, v_start, inputs, limits)
        v, h, scale, status, x, error, J = found
        return StackResult(v, h[sides], error[tasks], scale, PriorityStatus(status), x[sides], J[tasks])

    def constraints(self, q: Array, targets: Array) -> tuple[Array, Array, Array]:
        """Return values (c,), Jacobian (c, n) and own rates (c,) of the constraints, all as upper bounds."""
        references = np.zeros((len(self.tasks), REFERENCE_SIZE))
        inputs = np.asarray(q), references, targets, self._goal, self.robot.v_max
        rows = _rows(self._table, self.robot.kinematics(q).motion, *inputs)
        return rows.x[self._side_rows], rows.J[self._side_rows], rows.own[self._side_rows]


def evaluate_component(robot: RobotModel, component: Component, q: Array, targets: Array) -> tuple[float, Array, float]:
    """Return value, Jacobian (n,) and own rate of a component: ẋ_C = J q̇ + own rate."""
    inputs = np.array(q), np.zeros((0, REFERENCE_SIZE)), np.atleast_2d(targets), np.zeros(1), robot.v_max
    rows = _rows(table(robot, [row(component, 1.0, None)]), robot.kinematics(q).motion, *inputs)
    return float(rows.x[0]), rows.J[0], float(rows.own[0])


@njit(cache=True)
def _component(table, i, motion, q, targets, J_row):
    """Write the row of a component into J_row (zeroed); return its value (of a TURN: 0) and own rate ẋ_own."""
    kind, link, index = table.kind[i], table.link[i], table.number[i]
    if kind == Kind.JOINT:
        J_row[index] = 1.0
        return q[index], 0.0
    p_WC = world_point(motion, link, table.p_LC[i])
    J = jacobian(motion, link, p_WC)
    if kind == Kind.TURN:
        J_row[:] = J[index]
        return 0.0, 0.0
    if kind == Kind.PLANE:
        a = table.direction[i]
        J_row[:] = apply(J[3:].T, a)
        return a[0] * p_WC[0] + a[1] * p_WC[1] + a[2] * p_WC[2] - table.length[i], 0.0
    u, velocity = targets[index, :3] - p_WC, targets[index, 3:]
    distance = np.sqrt(np.sum(u * u))
    if distance < _NEAR:
        return (-table.length[i] if kind == Kind.DISTANCE else 0.0), 0.0
    u /= distance
    if kind == Kind.DISTANCE:
        J_row[:] = -apply(J[3:].T, u)
        return distance - table.length[i], np.sum(u * velocity)
    axis = table.direction[i].copy() if link < 0 else apply(motion.R_WL[link], table.direction[i])
    cosine = np.sum(axis * u)
    across = (axis - cosine * u) / distance
    J_row[:] = apply(J[:3].T, np.cross(axis, u)) - apply(J[3:].T, across)
    return cosine, np.sum(across * velocity)


@njit(cache=True)
def _rows(table, motion, q, references, targets, goal, v_max):
    """Return the `Rows` of a table; `goal` (r,) holds the bounds of the constraints."""
    count = table.kind.shape[0]
    x, own, J = np.empty(count), np.empty(count), np.zeros((count, q.shape[0]))
    goal, wanted = goal.copy(), np.empty(count)
    for i in range(count):
        sign = table.sign[i]
        value, rate = _component(table, i, motion, q, targets, J[i])
        x[i], own[i] = sign * value, sign * rate
        J[i] *= sign
        if table.task[i] >= 0:
            reference = references[table.task[i]]
            goal[i] = reference[table.column[i]]
            if table.kind[i] == Kind.TURN:
                link, R = table.link[i], table.R_LF[i].copy().reshape((3, 3))
                R = R if link < 0 else product(motion.R_WL[link], R)
                goal[i] = rotation_log(product(reference[:9].copy().reshape((3, 3)), R.T))[table.number[i]]
            wanted[i] = reference[table.rate_column[i]] + table.gain[i] * (goal[i] - x[i])
        else:
            wanted[i] = allowed_rate(J[i], x[i] - goal[i], own[i], table.gain[i], v_max)
    return Rows(J, x, own, goal, wanted, table.buffer, table.velocity_buffer)


@njit(cache=True)
def _solve(tree, levels, table, q, v_start, inputs, limits):
    (references, targets, bounds), (settings, change) = inputs, limits
    rows = _rows(table, tree_kinematics(tree, q, np.zeros_like(q)), q, references, targets, bounds, settings.v_max)
    v, h, scale, status = np.zeros_like(v_start), np.zeros_like(bounds), 0.0, PriorityStatus.INVALID.value
    if np.isfinite(q.sum() + v_start.sum() + references.sum() + targets.sum()):
        found = solve_stack(levels, rows, v_start, settings, change)
        if np.isfinite(found[0].sum()):
            v, h, scale, status = found
    return v, h, scale, status, rows.x, rows.goal - rows.x, rows.J
