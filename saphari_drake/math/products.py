"""Products, factors and eigenvectors of small matrices for compiled kernels, and multipliers of inequalities.

numba's own ``@``, ``dot`` and ``linalg`` call BLAS and LAPACK through SciPy, which nothing else here needs, and are
slower at these sizes.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit

_MAX_PASSES = 200
_TOLERANCE = 1e-11  # by which an inequality may be violated


@njit(cache=True)
def product(A, B):
    """Return A B of matrices (n, k) and (k, m)."""
    n, k, m = A.shape[0], A.shape[1], B.shape[1]
    C = np.empty((n, m))
    for i in range(n):
        for j in range(m):
            total = 0.0
            for l in range(k):
                total += A[i, l] * B[l, j]
            C[i, j] = total
    return C


@njit(cache=True)
def apply(A, x):
    """Return A x of a matrix (n, k) and a vector (k,)."""
    y = np.empty(A.shape[0])
    for i in range(A.shape[0]):
        total = 0.0
        for l in range(A.shape[1]):
            total += A[i, l] * x[l]
        y[i] = total
    return y


@njit(cache=True)
def all_finite(x):
    """Return whether all numbers of a vector are finite."""
    for i in range(len(x)):
        if not np.isfinite(x[i]):
            return False
    return True


@njit(cache=True)
def symmetric_eigen(A):
    """Return eigenvalues (n,), ascending, and eigenvectors as columns (n, n), of a symmetric matrix (Jacobi)."""
    n = A.shape[0]
    D, U = A.copy(), np.eye(n)
    for _ in range(50):
        off, size = 0.0, 0.0
        for i in range(n):
            size += D[i, i] * D[i, i]
            for j in range(i):
                off += D[i, j] * D[i, j]
        if off <= 1e-30 * (size + off):
            break
        for i in range(n):
            for j in range(i):
                if D[i, j] == 0.0:
                    continue
                theta = 0.5 * (D[i, i] - D[j, j]) / D[i, j]
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(n):
                    a, b = D[k, i], D[k, j]
                    D[k, i], D[k, j] = c * a + s * b, c * b - s * a
                for k in range(n):
                    a, b = D[i, k], D[j, k]
                    D[i, k], D[j, k] = c * a + s * b, c * b - s * a
                for k in range(n):
                    a, b = U[k, i], U[k, j]
                    U[k, i], U[k, j] = c * a + s * b, c * b - s * a
    values = np.empty(n)
    for i in range(n):
        values[i] = D[i, i]
    order = np.argsort(values)
    vectors = np.empty((n, n))
    for i in range(n):
        for k in range(n):
            vectors[k, i] = U[k, order[i]]
    return values[order], vectors


@njit(cache=True)
def cholesky(A, L):
    """Write the lower Cholesky factor of a symmetric matrix (m, m) into L and return whether it is positive definite.

    If not, the lower part of L is NaN: whoever goes on with it gets NaN, never a number that looks like a solution.
    L may be A itself.
    """
    m = A.shape[0]
    for j in range(m):
        d = A[j, j]
        for k in range(j):
            d -= L[j, k] * L[j, k]
        if not d > 0.0:
            for i in range(m):
                L[i, : i + 1] = np.nan
            return False
        d = np.sqrt(d)
        L[j, j] = d
        for i in range(j + 1, m):
            s = A[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = s / d
    return True


@njit(cache=True)
def solve_lower(L, b, m):
    """Solve L x = b in place, L of order m."""
    for i in range(m):
        s = b[i]
        for k in range(i):
            s -= L[i, k] * b[k]
        b[i] = s / L[i, i]


@njit(cache=True)
def solve_upper(L, b, m):
    """Solve Lᵀ x = b in place, L of order m."""
    for i in range(m - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, m):
            s -= L[k, i] * b[k]
        b[i] = s / L[i, i]


@njit(cache=True)
def bounded_multipliers(H, e):
    """Return μ ≥ 0 with H μ = e where μ > 0 and H μ ≥ e elsewhere, H positive definite (Lawson and Hanson 1974).

    All are NaN if H is not positive definite, or the active set is not found in 200 passes.
    """
    m = e.shape[0]
    mu = np.zeros(m)
    active = np.zeros(m, dtype=np.bool_)
    for _ in range(_MAX_PASSES):
        worst, choice = _TOLERANCE, -1
        for i in range(m):
            if not active[i]:
                g = e[i]
                for k in range(m):
                    if active[k]:
                        g -= H[i, k] * mu[k]
                if not g <= worst:  # a NaN as well
                    worst, choice = g, i
        if choice < 0:
            return mu
        active[choice] = True
        if not _move_active(H, e, active, mu):
            break
    mu[:] = np.nan
    return mu


@njit(cache=True)
def _move_active(H, e, active, mu):
    """Move the active μ to H μ = e, dropping those that reach 0 on the way; return False if H is not definite."""
    while True:
        order = np.flatnonzero(active)
        count = order.shape[0]
        A, K, z = np.empty((count, count)), np.empty((count, count)), np.empty(count)
        for a in range(count):
            z[a] = e[order[a]]
            for b in range(count):
                A[a, b] = H[order[a], order[b]]
        if not cholesky(A, K):
            return False
        solve_lower(K, z, count)
        solve_upper(K, z, count)
        ratio, blocking = 1.0, -1
        for a in range(count):
            if z[a] <= 0.0:
                part = mu[order[a]] / (mu[order[a]] - z[a]) if mu[order[a]] > 0.0 else 0.0
                if part < ratio:
                    ratio, blocking = part, order[a]
        for a in range(count):
            mu[order[a]] += ratio * (z[a] - mu[order[a]])
        if blocking < 0:
            return True
        mu[blocking] = 0.0
        active[blocking] = False
