"""Dual active-set solver (Goldfarb and Idnani, 1983) for the `Subproblem` of a horizon.

The price ρ of the slacks bounds the multipliers of the distance rows instead of adding variables: with λ < ρ a row
holds exactly, s = 0; at λ ≥ ρ it is soft, s = λ/ρ − 1. That is the exact ℓ1 penalty, with a small quadratic part that
makes the solution unique.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.control.nmpc.solvers.active_set import (
    DEPENDENT,
    add,
    append,
    empty_set,
    factor,
    inner,
    load,
    most_violated,
    remove,
    solve,
)
from saphari_drake.control.nmpc.solvers.subproblem import LIMITS, QpSolution, QpStatus, solve_lower, solve_upper

# What ends a step, if it is not an active constraint: the violation is gone, or the row's multiplier is its price.
_FULL, _PRICE = -1, -2


@njit(cache=True)
def solve_qp(qp, guess, passes=20):
    """Solve a `Subproblem`.

    Parameters
    ----------
    qp : Subproblem
    guess : (any,) int array
        Limits that may be active; others follow, wrong ones go.
    passes : int
        The active set changes at most so many times for each variable.

    Returns
    -------
    QpSolution
    """
    y, x, steps = -qp.g, np.zeros_like(qp.g), 0
    at = empty_set(qp)
    status = QpStatus.SOLVED if qp.definite else QpStatus.INDEFINITE
    if qp.definite:
        solve_lower(qp, 0, y)
        status = _start(qp, at, guess, y)
        solve_upper(qp, y, x)
    while status == QpStatus.SOLVED:
        p, violation = most_violated(qp, x, at.listed)
        if p < 0:
            break
        status, steps = _activate(qp, at, p, violation, y, steps, passes * y.size)
        solve_upper(qp, y, x)
    if status == QpStatus.SOLVED and not np.isfinite(np.sum(x)):
        status = QpStatus.INDEFINITE
    return _solution(qp, at, x, status)


@njit(cache=True)
def _start(qp, at, guess, y):
    """Add equalities and the guess at once, drop or soften what has a multiplier of the wrong sign; update y."""
    first_slip = LIMITS * y.size + qp.rows.z.shape[0]
    equalities = qp.slip.z.shape[0]
    w, right = np.empty_like(y), np.empty_like(at.lam)
    for e in range(equalities + guess.shape[0]):
        index = first_slip + e if e < equalities else guess[e - equalities]
        if at.listed[index] or at.size[0] >= y.size:
            continue
        bound, first = load(qp, index, w)
        if not np.isfinite(bound):
            continue
        solve_lower(qp, first, w)
        if not append(qp, at, index, w, bound, first) and e < equalities:
            return QpStatus.INFEASIBLE
    changed, none = 0, at.lam.shape[0]
    while changed < none:
        for i in range(at.size[0]):
            right[i] = at.bound[i] - inner(at.W[i], y, at.start[i]) + (1.0 if at.soft[i] else 0.0)
        solve(at, right, at.lam)
        changed = _correct(qp, at)
        if not factor(qp, at, changed, at.size[0]):
            return QpStatus.INDEFINITE
    for i in range(at.size[0]):
        add(y, at.lam[i], at.W[i], at.start[i])
    return QpStatus.SOLVED


@njit(cache=True)
def _correct(qp, at):
    """Drop what has λ < 0, soften or harden rows by λ and the price; return the first place changed, or a later one."""
    first_row = LIMITS * qp.g.size
    first_slip = first_row + qp.rows.z.shape[0]
    changed, i = at.lam.shape[0], 0
    while i < at.size[0]:
        kind, lam = at.member[i], at.lam[i]
        if kind < first_slip and (lam < 0.0 or (at.soft[i] and lam < qp.price)):
            remove(at, i)
            changed = min(changed, i)
            continue
        if first_row <= kind < first_slip and not at.soft[i] and lam > qp.price:
            at.soft[i] = True
            changed = min(changed, i)
        i += 1
    return changed


@njit(cache=True)
def _activate(qp, at, p, violation, y, steps, most_steps):
    """Raise the multiplier of the violated constraint p until it holds, is soft, or cannot; return status and steps."""
    w, right, r = np.empty_like(y), np.empty_like(at.lam), np.empty_like(at.lam)
    bound, first = load(qp, p, w)
    solve_lower(qp, first, w)
    square, is_row, soft, lam = inner(w, w, first), p >= LIMITS * y.size, False, 0.0
    while steps < most_steps:
        steps += 1
        rate = square + (1.0 / qp.price if soft else 0.0)
        for i in range(at.size[0]):
            right[i] = inner(at.W[i], w, max(first, at.start[i]))
        solve(at, right, r)
        for i in range(at.size[0]):
            rate -= right[i] * r[i]
        possible = rate > DEPENDENT * square
        length, blocking = _step_length(qp, at, r, -violation / rate if possible else np.inf)
        if is_row and not soft and qp.price - lam < length:
            length, blocking = qp.price - lam, _PRICE
        if not np.isfinite(length):
            return QpStatus.INFEASIBLE, steps
        lam += length
        for i in range(at.size[0]):
            at.lam[i] -= length * r[i]
        if possible:
            violation += length * rate
            add(y, length, w, first)
            for i in range(at.size[0]):
                add(y, -length * r[i], at.W[i], at.start[i])
        if blocking == _PRICE:
            soft = True
        elif blocking == _FULL:
            if at.size[0] == at.lam.shape[0]:
                return QpStatus.EXHAUSTED, steps
            at.soft[at.size[0]], at.lam[at.size[0]] = soft, lam
            independent = append(qp, at, p, w, bound, first)
            return (QpStatus.SOLVED if independent else QpStatus.INDEFINITE), steps
        elif not _release(qp, at, blocking, r[blocking]):
            return QpStatus.INDEFINITE, steps
    return QpStatus.EXHAUSTED, steps


@njit(cache=True)
def _step_length(qp, at, r, full):
    """Return how far λ can go along −r, at most `full`, until a multiplier comes to zero or its price, and which."""
    first_row = LIMITS * qp.g.size
    first_slip = first_row + qp.rows.z.shape[0]
    length, blocking = full, _FULL
    for i in range(at.size[0]):
        room = np.inf
        if at.member[i] >= first_slip:
            continue
        if r[i] > 0.0:
            room = (at.lam[i] - (qp.price if at.soft[i] else 0.0)) / r[i]
        elif r[i] < 0.0 and not at.soft[i] and at.member[i] >= first_row:
            room = (qp.price - at.lam[i]) / -r[i]
        if room < length:
            length, blocking = max(room, 0.0), i
    return length, blocking


@njit(cache=True)
def _release(qp, at, i, rate):
    """Take out the constraint whose multiplier came to zero, or turn it soft or hard where that came to its price."""
    if rate > 0.0 and not at.soft[i]:
        remove(at, i)
    else:
        at.soft[i], at.lam[i] = not at.soft[i], qp.price
    return factor(qp, at, i, at.size[0])


@njit(cache=True)
def _solution(qp, at, x, status):
    """Return the `QpSolution` of a step and the active set there."""
    rows, first_row = qp.rows.z.shape[0], LIMITS * x.size
    multipliers, slack, active = np.zeros(rows), np.zeros(rows), np.empty(at.size[0], np.int64)
    largest, limits = 0.0, 0
    for i in range(at.size[0]):
        r = at.member[i] - first_row
        if r < 0:
            active[limits] = at.member[i]
            limits += 1
            continue
        largest = max(largest, abs(at.lam[i]))
        if r < rows:
            multipliers[r] = at.lam[i]
            slack[r] = at.lam[i] / qp.price - 1.0 if at.soft[i] else 0.0
    return QpSolution(x, multipliers, slack, largest, active[:limits], status)
