"""DAQP (Arnström, Bemporad and Axehill, 2022) for the `Subproblem` of a horizon, written as dense matrices."""

from __future__ import annotations

import daqp
import numpy as np

from saphari_drake.control.nmpc.solvers.subproblem import QpSolution, QpStatus, Subproblem, spread

_EQUALITY, _INFINITY = 5, 1.0e30  # as DAQP writes them
_STATUS = {1: QpStatus.SOLVED, -2: QpStatus.EXHAUSTED, -4: QpStatus.EXHAUSTED, -5: QpStatus.INDEFINITE}


def solve_dense(qp: Subproblem, passes: int = 20) -> QpSolution:
    """Solve a `Subproblem` as `dual.solve_qp` does; from no guess, as the number of rows differs from one to the next.

    Parameters
    ----------
    qp : Subproblem
    passes : int
        The active set changes at most so many times for each variable.
    """
    rows, nothing = len(qp.rows.z), np.zeros(0, np.int64)
    if not (qp.definite and np.isfinite(qp.g).all()):
        return QpSolution(qp.g, np.zeros(rows), np.zeros(rows), 0.0, nothing, QpStatus.INDEFINITE)
    # The hard rows hold in the solution of the soft ones too, if no multiplier exceeds the price.
    x, dual, flag = _solve(qp, 0, passes)
    if flag == -1 or np.any(dual[:rows] > qp.price):
        x, dual, flag = _solve(qp, rows, passes)
    slack = np.maximum(dual[:rows] / qp.price - 1.0, 0.0)
    largest = float(dual.max(initial=0.0))
    status = _STATUS.get(flag, QpStatus.INFEASIBLE)
    return QpSolution(x[: qp.g.size].reshape(qp.g.shape), dual[:rows], slack, largest, nothing, status)


def _solve(qp: Subproblem, slacks: int, passes: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return (δ, s), absolute multipliers of distances and slip, and DAQP's exit flag; all rows or none are soft."""
    (N, n), size, rows, e = qp.g.shape, qp.g.size, len(qp.rows.z), len(qp.slip.z)
    turns = np.flatnonzero(np.isfinite(qp.a_high.ravel()))
    H, A = np.zeros((size + slacks, size + slacks)), np.zeros((size + len(turns) + rows + e, size + slacks))
    H[size:, size:] = qp.price * np.eye(slacks)
    for k in range(N):
        here, before = slice(k * n, k * n + n), slice(k * n - n, k * n)
        H[here, here], A[here, here] = qp.H[k], np.eye(n)
        if k > 0:
            H[here, before] = H[before, here] = -np.diag(qp.off)
            A[here, before] = -np.eye(n)
    change = A[:size, :size].copy()
    change[n:] -= A[: size - n, :size]
    first = size + len(turns)
    A[size:first, :size] = change[turns]
    A[first : first + rows, :size], A[first + rows :, :size] = spread(qp.rows, N), spread(qp.slip, N)
    A[first : first + slacks, size:] = np.eye(slacks)
    a_low, a_high = qp.a_low.ravel()[turns], qp.a_high.ravel()[turns]
    lower = np.concatenate([qp.low.ravel(), np.zeros(slacks), qp.v_low.ravel(), a_low, -qp.rows.z, -qp.slip.z])
    none = np.full(slacks + rows, np.inf)
    upper = np.concatenate([qp.high.ravel(), none[:slacks], qp.v_high.ravel(), a_high, none[slacks:], -qp.slip.z])
    if np.any(lower > upper):  # which DAQP does not notice
        return np.zeros(len(H)), np.zeros(rows + e), -1
    x, _, flag, info = daqp.solve(
        H,
        np.concatenate([qp.g.ravel(), np.full(slacks, qp.price)]),
        A,
        np.minimum(upper, _INFINITY),
        np.maximum(lower, -_INFINITY),
        np.where(np.arange(len(lower)) < len(lower) - e, 0, _EQUALITY).astype(np.int32),
        primal_tol=1e-9,
        iter_limit=passes * size,
    )
    return np.asarray(x), np.abs(info["lam"])[2 * size + slacks + len(turns) :], flag
