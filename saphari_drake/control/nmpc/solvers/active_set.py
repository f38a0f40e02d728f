"""The active set of a `Subproblem`: which constraints hold with equality, their transformed rows and multipliers.

H = L Lᵀ is block tridiagonal, so that L has two blocks a stage, and only constraints cᵀδ ≥ b that ever become active
are transformed, w = L⁻¹c. In y = Lᵀδ = y_0 + Σ λᵢwᵢ their multipliers solve (WᵀW + D)λ = b − cᵀδ_0, D = 1/ρ for rows
that are soft.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.control.nmpc.solvers.subproblem import LIMITS

Array = NDArray[np.float64]

_TOLERANCE = 1.0e-9  # by which a constraint may be violated
DEPENDENT = 1.0e-10  # share of ‖w‖² that is left of a w which depends on others


class ActiveSet(NamedTuple):
    """Constraints in the first `size` places of each array, numbered as `load` does."""

    size: NDArray[np.int64]  # (1,), how many places are taken
    member: NDArray[np.int64]
    listed: NDArray[np.bool_]  # of all constraints
    soft: NDArray[np.bool_]
    W: Array  # (most, N, n), w = L⁻¹c
    start: NDArray[np.int64]  # first stage at which w is not zero
    bound: Array
    lam: Array  # multipliers
    gram: Array  # (most, most), WᵀW
    R: Array  # (most, most), Cholesky factor of WᵀW + D


@njit(cache=True)
def empty_set(qp):
    """Return an `ActiveSet` with room for all that can be active at once."""
    N, n = qp.g.shape
    rows = qp.rows.z.shape[0]
    most = N * n + 1 + min(rows, N * n)
    return ActiveSet(
        np.zeros(1, np.int64),
        np.empty(most, np.int64),
        np.zeros(LIMITS * N * n + rows + qp.slip.z.shape[0], np.bool_),
        np.zeros(most, np.bool_),
        np.empty((most, N, n)),
        np.empty(most, np.int64),
        np.empty(most),
        np.zeros(most),
        np.empty((most, most)),
        np.empty((most, most)),
    )


@njit(cache=True)
def load(qp, index, c):
    """Write constraint `index` as c (N, n) of cᵀδ ≥ b; return b and the first stage that it touches.

    First come the limits of velocity, upper and lower of each joint stage by stage, then those of position, then those
    of the change of velocity, then the distance rows, then the slip rows.
    """
    N, n = qp.g.shape
    c[:] = 0.0
    limits = 2 * N * n
    if index < 3 * limits:
        half = index % limits
        side, k, j = half % 2, half // 2 // n, half // 2 % n
        sign = -1.0 if side == 0 else 1.0
        c[k, j] = sign
        if index >= 2 * limits:
            if k > 0:
                c[k - 1, j] = -2.0 * sign
            if k > 1:
                c[k - 2, j] = sign
            return (-qp.a_high[k, j] if side == 0 else qp.a_low[k, j]), max(k - 2, 0)
        if index >= limits:
            return (-qp.high[k, j] if side == 0 else qp.low[k, j]), k
        if k > 0:
            c[k - 1, j] = -sign
        return (-qp.v_high[k, j] if side == 0 else qp.v_low[k, j]), max(k - 1, 0)
    r, rows = index - 3 * limits, qp.rows
    if r >= rows.z.shape[0]:
        r -= rows.z.shape[0]
        rows = qp.slip
    k = rows.stage[r] - 1
    c[k] = rows.b[r]
    if k > 0:
        c[k - 1] = rows.a[r]
    return -rows.z[r], max(k - 1, 0)


@njit(cache=True)
def most_violated(qp, x, listed):
    """Return the index of the most violated inequality that is not active, and cᵀx − b there; −1 if none is."""
    N, n = x.shape
    limits = 2 * N * n
    worst, found = -_TOLERANCE, -1
    for k in range(N):
        for j in range(n):
            i = 2 * (k * n + j)
            before = x[k - 1, j] if k > 0 else 0.0
            step = x[k, j] - before
            turn = step - before + (x[k - 2, j] if k > 1 else 0.0)
            for index, s in (
                (i, qp.v_high[k, j] - step),
                (i + 1, step - qp.v_low[k, j]),
                (limits + i, qp.high[k, j] - x[k, j]),
                (limits + i + 1, x[k, j] - qp.low[k, j]),
                (2 * limits + i, qp.a_high[k, j] - turn),
                (2 * limits + i + 1, turn - qp.a_low[k, j]),
            ):
                if s < worst and not listed[index]:
                    worst, found = s, index
    for r in range(qp.rows.z.shape[0]):
        k = qp.rows.stage[r] - 1
        s = qp.rows.z[r]
        for j in range(n):
            s += qp.rows.b[r, j] * x[k, j]
            if k > 0:
                s += qp.rows.a[r, j] * x[k - 1, j]
        if s < worst and not listed[3 * limits + r]:
            worst, found = s, 3 * limits + r
    return found, worst


@njit(cache=True)
def factor(qp, at, first, count):
    """Factorize WᵀW + D of the first `count` constraints from row `first` on; return False if it is singular."""
    for i in range(first, count):
        for j in range(i + 1):
            total = at.gram[i, j]
            if i == j and at.soft[i]:
                total += 1.0 / qp.price
            for l in range(j):
                total -= at.R[i, l] * at.R[j, l]
            if i != j:
                at.R[i, j] = total / at.R[j, j]
            elif total > DEPENDENT * at.gram[i, i]:
                at.R[i, i] = np.sqrt(total)
            else:
                return False
    return True


@njit(cache=True)
def solve(at, right, out):
    """Write (WᵀW + D)⁻¹ right into `out`."""
    R, count = at.R, at.size[0]
    for i in range(count):
        total = right[i]
        for j in range(i):
            total -= R[i, j] * out[j]
        out[i] = total / R[i, i]
    for i in range(count - 1, -1, -1):
        out[i] /= R[i, i]
        for j in range(i):
            out[j] -= R[i, j] * out[i]


@njit(cache=True)
def inner(a, b, first):
    """Inner product of two (N, n) arrays from block `first` on."""
    total = 0.0
    for k in range(first, a.shape[0]):
        for j in range(a.shape[1]):
            total += a[k, j] * b[k, j]
    return total


@njit(cache=True)
def add(y, scale, w, first):
    """Add scale·w to y, both (N, n), from block `first` on."""
    for k in range(first, y.shape[0]):
        for j in range(y.shape[1]):
            y[k, j] += scale * w[k, j]


@njit(cache=True)
def append(qp, at, index, w, bound, first):
    """Append a constraint w = L⁻¹c, and return whether it is independent of the others; if not, it is left out."""
    i = at.size[0]
    at.W[i] = w
    at.member[i], at.bound[i], at.start[i] = index, bound, first
    for j in range(i + 1):
        at.gram[i, j] = inner(at.W[j], w, max(first, at.start[j]))
        at.gram[j, i] = at.gram[i, j]
    if not factor(qp, at, i, i + 1):
        return False
    at.listed[index] = True
    at.size[0] += 1
    return True


@njit(cache=True)
def remove(at, i):
    """Take constraint i out of the active set."""
    count = at.size[0]
    at.listed[at.member[i]] = False
    for a in range(i, count - 1):
        at.member[a], at.lam[a], at.bound[a] = at.member[a + 1], at.lam[a + 1], at.bound[a + 1]
        at.soft[a], at.start[a] = at.soft[a + 1], at.start[a + 1]
        at.W[a] = at.W[a + 1]
        for b in range(count):
            at.gram[a, b] = at.gram[a + 1, b]
    for a in range(i, count - 1):
        for b in range(count):
            at.gram[b, a] = at.gram[b, a + 1]
    at.size[0] -= 1
