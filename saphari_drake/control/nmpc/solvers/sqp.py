"""Sequential quadratic programming on the problem of `law`, after Nocedal and Wright (2006), algorithm 18.3.

Each iteration solves the `Subproblem` at the iterate and lowers cost + penalty·violation
along it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.control.nmpc.data import HorizonData, Scene, no_multipliers
from saphari_drake.control.nmpc.horizon import evaluate
from saphari_drake.control.nmpc.limits import feasible_start, step_limits
from saphari_drake.control.nmpc.rows import distance_rows, kept_distances, slack_length, slip_rows, violation
from saphari_drake.control.nmpc.solvers.dense import solve_dense
from saphari_drake.control.nmpc.solvers.dual import solve_qp
from saphari_drake.control.nmpc.solvers.subproblem import QpStatus, Subproblem, factorize_shifted

Array = NDArray[np.float64]

ARMIJO, SMALLEST_STEP = 1.0e-4, 1.0e-3  # of the line search
# rad or m; guesses of the largest entry of a step, see `rows`.
FIRST_REACH, REACH_FACTOR, LEAST_REACH = 0.05, 2.0, 0.01


class SqpOptions(NamedTuple):
    """How far the SQP goes."""

    iterations: int  # most QPs
    tolerance: float  # largest entry of the last step (rad or m)
    price: float  # of 1 m² of slack
    exact: bool  # exact Hessian of the Lagrangian


class Iterate(NamedTuple):
    """Where the SQP is."""

    Q: Array  # (N, n), positions of stages 1 … N
    multipliers: Array  # (N + 1, points, m), of the distance rows
    active: NDArray[np.int64]  # limits, as a guess for the next QP
    penalty: float  # on violations, in the line search
    reach: float  # guess of the largest entry of the next step
    slack: float  # largest violation that the last QP could not remove, as length (m)
    solved: int  # QPs
    converged: bool
    status: QpStatus  # of the last QP


@njit(cache=True)
def start_sqp(data, scene, guess):
    """Return the first `Iterate`: a guess (N, n), moved into the limits."""
    none = no_multipliers(scene, guess.shape[0], data.link_C.shape[0])
    Q = feasible_start(data, scene, guess)
    return Iterate(Q, none, np.zeros(0, np.int64), 0.0, FIRST_REACH, 0.0, 0, False, QpStatus.SOLVED)


@njit(cache=True)
def linearize(data, scene, at, options):
    """Return the `Subproblem` at an iterate, its cost and violation Σ max(0, −z) + Σ |slip|, and distances kept."""
    cost = evaluate(data, scene, at.Q, at.multipliers, options.exact, True)
    off = 2.0 / data.period**2 * data.Q_v
    L, B, definite = factorize_shifted(cost.H, off)
    kept = kept_distances(data, scene.q0, at.Q, cost.J)
    rows = distance_rows(data, scene, at.Q, cost, kept, at.reach, False)
    slip = slip_rows(data, scene.q0, at.Q)
    l = step_limits(data, scene, at.Q)
    qp = Subproblem(
        cost.g, cost.H, off, L, B, definite, l[0], l[1], l[2], l[3], l[4], l[5], rows, slip, options.price
    )  # fmt: skip
    excess = np.sum(np.maximum(0.0, -rows.z)) + np.sum(np.abs(slip.z))
    return qp, cost.f, excess, kept


@njit(cache=True)
def search(data, scene, at, linear, step, penalty):
    """Return Q + α δ with the largest α = 1, ½, ¼ … that lowers cost + penalty·violation enough, for a `QpSolution`."""
    qp, f, excess, kept = linear
    slope = np.sum(qp.g * step.delta) - penalty * max(excess - np.sum(step.slack), 0.0)
    start, alpha = f + penalty * excess, 1.0
    while True:
        Q = at.Q + alpha * step.delta
        trial = evaluate(data, scene, Q, at.multipliers, False, False)
        left = violation(data, scene, trial.P, kept) + np.sum(np.abs(slip_rows(data, scene.q0, Q).z))
        alpha *= 0.5
        enough = start + ARMIJO * 2.0 * alpha * min(slope, 0.0) + 1e-12 * abs(start)
        if trial.f + penalty * left <= enough or alpha < SMALLEST_STEP:
            return Q


@njit(cache=True)
def iterate(data, scene, at, linear, step, options):
    """Return the next `Iterate` from a `QpSolution`; the same with a larger reach where the step exceeds it."""
    rows = linear[0].rows
    largest = np.max(np.abs(step.delta))
    if step.status != QpStatus.SOLVED:
        return Iterate(
            at.Q, at.multipliers, at.active, at.penalty, at.reach, at.slack, at.solved + 1, False, step.status
        )
    if largest > at.reach:
        return Iterate(
            at.Q, at.multipliers, step.active, at.penalty, 4.0 * largest, at.slack, at.solved, False, step.status
        )
    slack = slack_length(data, scene, rows, step.slack)
    penalty = max(at.penalty, min(2.0 * step.largest, options.price))
    multipliers = np.zeros_like(at.multipliers)
    for r in range(rows.z.shape[0]):
        # A swept first interval bends otherwise than these do.
        if not (data.swept and rows.stage[r] == 1):
            multipliers[rows.stage[r], rows.point[r], rows.obstacle[r]] = step.multipliers[r]
    converged = largest <= options.tolerance
    Q = at.Q + step.delta if converged else search(data, scene, at, linear, step, penalty)
    reach = max(REACH_FACTOR * largest, LEAST_REACH)
    return Iterate(Q, multipliers, step.active, penalty, reach, slack, at.solved + 1, converged, step.status)


@njit(cache=True)
def unfinished(at, options):
    """Return whether the SQP goes on."""
    return at.solved < options.iterations and not at.converged and at.status == QpStatus.SOLVED


@njit(cache=True)
def solve_sqp(data, scene, guess, options):
    """Return the last `Iterate` of the SQP from a guess (N, n), with the compiled active-set solver."""
    at = start_sqp(data, scene, guess)
    while unfinished(at, options):
        linear = linearize(data, scene, at, options)
        at = iterate(data, scene, at, linear, solve_qp(linear[0], at.active), options)
    return at


def solve_sqp_within(
    data: HorizonData,
    scene: Scene,
    guess: Array,
    options: SqpOptions,
    seconds: float,
    clock: Callable[[], float] = time.perf_counter,
) -> Iterate:
    """Return the last `Iterate` of `solve_sqp` that was begun within that time, the first one at least."""
    end, at = clock() + seconds, start_sqp(data, scene, guess)
    while unfinished(at, options) and (at.solved == 0 or clock() < end):
        linear = linearize(data, scene, at, options)
        at = iterate(data, scene, at, linear, solve_qp(linear[0], at.active), options)
    return at


def solve_sqp_dense(data: HorizonData, scene: Scene, guess: Array, options: SqpOptions) -> Iterate:
    """Return the last `Iterate` of the SQP from a guess (N, n), with DAQP."""
    at = start_sqp(data, scene, guess)
    while unfinished(at, options):
        linear = linearize(data, scene, at, options)
        at = iterate(data, scene, at, linear, solve_dense(linear[0]), options)
    return at
