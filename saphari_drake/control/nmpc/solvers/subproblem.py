"""The quadratic program of one iteration, as its solvers take it, and the factor of its Hessian."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math import products
from saphari_drake.math.products import cholesky

Array = NDArray[np.float64]

# Shares of the velocity term's Hessian: the least pivot of a factorization, and what is added to an indefinite H first.
_LEAST_PIVOT, _FIRST_SHIFT, _SHIFT_FACTOR, _MOST_SHIFT = 0.01, 0.02, 4.0, 1e12


# Limits of a joint at a stage, upper and lower, of its velocity, its position and its change of velocity.
LIMITS = 6


class QpStatus(IntEnum):
    """What a solver found."""

    SOLVED = 0
    INFEASIBLE = 1  # hard constraints contradict each other
    INDEFINITE = 2  # a matrix is not positive definite, or an entry is not finite
    EXHAUSTED = 3  # too many passes


class Rows(NamedTuple):
    """Linearised inequalities z + a·δ_{k−1} + b·δ_k ≥ 0, with δ_0 = 0."""

    stage: NDArray[np.int64]  # (rows,), k = 1 … N
    point: NDArray[np.int64]  # (rows,)
    obstacle: NDArray[np.int64]  # (rows,)
    z: Array  # (rows,)
    a: Array  # (rows, n)
    b: Array  # (rows, n)


class Subproblem(NamedTuple):
    """Minimize gᵀδ + ½ δᵀHδ + ρ Σ (s + ½ s²) over the step δ (N, n) and the slacks s ≥ 0 of the distance rows.

    H is block tridiagonal, H = L Lᵀ with diagonal blocks of L and those before them, B.
    """

    g: Array  # (N, n)
    H: Array  # (N, n, n), diagonal blocks
    off: Array  # (n,), the blocks beside them are −diag(off)
    L: Array  # (N, n, n), lower triangular
    B: Array  # (N, n, n), L_{k,k−1}; the first is zero
    definite: bool  # whether there is such a factor
    low: Array  # (N, n), bounds of δ
    high: Array
    v_low: Array  # (N, n), bounds of δ_k − δ_{k−1}
    v_high: Array
    a_low: Array  # (N, n), bounds of δ_k − 2δ_{k−1} + δ_{k−2}
    a_high: Array
    rows: Rows  # distances: z + a·δ_{k−1} + b·δ_k + s ≥ 0
    slip: Rows  # equalities z + a·δ_{k−1} + b·δ_k = 0
    price: float  # ρ


class QpSolution(NamedTuple):
    """What a solver returns; nothing but `status` may be used unless that is SOLVED."""

    delta: Array  # (N, n)
    multipliers: Array  # (rows,), of the distance rows
    slack: Array  # (rows,)
    largest: float  # largest multiplier (absolute) of a distance or slip row
    active: NDArray[np.int64]  # limits that are active, as the next guess
    status: QpStatus


def spread(rows: Rows, N: int) -> Array:
    """Return a and b as dense rows (rows, N n)."""
    count, n = rows.b.shape
    G = np.zeros((count, N, n))
    each, later = np.arange(count), np.flatnonzero(rows.stage > 1)
    G[each, rows.stage - 1] = rows.b
    G[later, rows.stage[later] - 2] = rows.a[later]
    return G.reshape(count, N * n)


@njit(cache=True)
def factorize_shifted(H, off):
    """Return L, B and whether there are any, after adding to the diagonal of an indefinite H what it takes."""
    N, n = H.shape[0], H.shape[1]
    L, B = np.empty((N, n, n)), np.zeros((N, n, n))
    shift = _FIRST_SHIFT
    while not factorize(H, off, L, B):
        if not shift <= _MOST_SHIFT:
            return L, B, False
        for k in range(N):
            for j in range(n):
                H[k, j, j] += shift * off[j]
        shift *= _SHIFT_FACTOR
    return L, B, True


@njit(cache=True)
def factorize(H, off, L, B):
    """Factorize the block tridiagonal H: diagonal blocks, and −diag(off) beside them; False if it is not definite."""
    N, n = H.shape[0], H.shape[1]
    for k in range(N):
        A = L[k]
        for i in range(n):
            for j in range(n):
                A[i, j] = H[k, i, j] if j <= i else 0.0
        if k > 0:
            _eliminate(off, L[k - 1], B[k], A)
        if not cholesky(A, A):
            return False
        for j in range(n):
            if not A[j, j] * A[j, j] > _LEAST_PIVOT * off[j]:
                return False
    return True


@njit(cache=True, inline="always")
def _eliminate(off, before, C, A):
    """Write C = −diag(off) L_{k−1}⁻ᵀ, whose row i starts at column i, and subtract C Cᵀ from A."""
    n = off.shape[0]
    for i in range(n):
        for j in range(i):
            C[i, j] = 0.0
        C[i, i] = -off[i] / before[i, i]
        for j in range(i + 1, n):
            total = 0.0
            for l in range(i, j):
                total -= before[j, l] * C[i, l]
            C[i, j] = total / before[j, j]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for l in range(i, n):
                total += C[i, l] * C[j, l]
            A[i, j] -= total


@njit(cache=True)
def solve_lower(qp, first, w):
    """Overwrite `w` (N, n) by L⁻¹w; its blocks before `first` are zero."""
    N, n = w.shape
    L, B = qp.L, qp.B
    for k in range(first, N):
        if k > first:
            for i in range(n):
                total = w[k, i]
                for j in range(i, n):
                    total -= B[k, i, j] * w[k - 1, j]
                w[k, i] = total
        products.solve_lower(L[k], w[k], n)


@njit(cache=True)
def solve_upper(qp, y, x):
    """Write L⁻ᵀy into `x` (N, n)."""
    N, n = y.shape
    L, B = qp.L, qp.B
    for k in range(N - 1, -1, -1):
        x[k] = y[k]
        if k < N - 1:
            for i in range(n):
                for j in range(i, n):
                    x[k, j] -= B[k + 1, i, j] * x[k + 1, i]
        products.solve_upper(L[k], x[k], n)
