"""Small dense problems inside compiled passes: Cholesky factors, and multipliers of inequality constraints."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit

_MAX_PASSES = 200
_TOLERANCE = 1e-11


@njit(cache=True)
def cholesky(A, L):
    """Write the lower Cholesky factor of a positive definite matrix into L."""
    m = A.shape[0]
    for j in range(m):
        d = A[j, j]
        for k in range(j):
            d -= L[j, k] * L[j, k]
        d = np.sqrt(max(d, 1e-300))
        L[j, j] = d
        for i in range(j + 1, m):
            s = A[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = s / d


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
    """Return μ ≥ 0 with H μ = e where μ > 0 and H μ ≥ e elsewhere, H positive definite (Lawson and Hanson 1974)."""
    m = e.shape[0]
    mu = np.zeros(m)
    active = np.zeros(m, dtype=np.bool_)
    order = np.empty(m, dtype=np.int64)
    A, K, z = np.empty((m, m)), np.zeros((m, m)), np.empty(m)
    for _ in range(_MAX_PASSES):
        worst, choice = _TOLERANCE, -1
        for i in range(m):
            if not active[i]:
                g = e[i]
                for k in range(m):
                    if active[k]:
                        g -= H[i, k] * mu[k]
                if g > worst:
                    worst, choice = g, i
        if choice < 0:
            break
        active[choice] = True
        while True:
            count = 0
            for i in range(m):
                if active[i]:
                    order[count] = i
                    count += 1
            for a in range(count):
                z[a] = e[order[a]]
                for b in range(count):
                    A[a, b] = H[order[a], order[b]]
            cholesky(A[:count, :count], K[:count, :count])
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
                break
            mu[blocking] = 0.0
            active[blocking] = False
    return mu
