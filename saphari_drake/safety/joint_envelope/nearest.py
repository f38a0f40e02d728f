"""The nearest acceleration that meets linear limits, by a dual active-set method; compiled."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply, cholesky, solve_lower, solve_upper

_MAX_STEPS = 100
_TOLERANCE = 1e-9


@njit(cache=True)
def nearest(H_inv, x0, C, low, high, x, active):
    """Write into x (n,) the point with low ≤ C x ≤ high that is nearest to x0 in the metric of H; return whether found.

    Dual active set (Goldfarb and Idnani, Math. Programming 1983): limits are met one after the other, the most violated
    first, from x0 on, so that without a violated one nothing is solved. Nothing is found if the limits contradict one
    another, or after 100 steps; x is then of no use.

    Parameters
    ----------
    H_inv : (n, n) array
        Inverse of the metric, positive definite.
    x0 : (n,) array
        The wish.
    C, low, high : (m, n), (m,) and (m,) arrays
        Limits, met to 1e-9 of their size or 1e-9.
    x, active : (n,) array, (m,) int array
        Results; +1 where the upper, −1 where the lower limit holds x back, 0 elsewhere.
    """
    n = len(x0)
    x[:] = x0
    active[:] = 0
    which, price = np.empty(n, dtype=np.int64), np.zeros(n + 1)
    rows, pulled = np.empty((n, n)), np.empty((n, n))  # signed normals of the active limits, and H⁻¹ times them
    k = 0
    side, p, violation = 0, -1, 0.0
    for _ in range(_MAX_STEPS):
        if p < 0:
            side, p, violation = _most_violated(C, low, high, x)
            if p < 0:
                return True
            if active[p] != 0:
                return False  # rounding: what is active is not met
            price[k] = 0.0
        normal = -side * C[p]
        whole = apply(H_inv, normal)
        slopes, toward = _slopes(rows[:k], pulled[:k], whole)
        dual, leaving = np.inf, -1
        for j in range(k):
            if slopes[j] > 1e-12 and price[j] / slopes[j] < dual:
                dual, leaving = price[j] / slopes[j], j
        curvature = (toward * normal).sum()
        primal = violation / curvature if k < n and curvature > 1e-12 * (whole * normal).sum() else np.inf
        step = min(dual, primal)
        if step == np.inf:
            return False
        price[:k] -= step * slopes
        price[k] += step
        if primal < np.inf:
            x += step * toward
            violation -= step * curvature
        if dual < primal:
            active[which[leaving]] = 0
            for j in range(leaving, k - 1):
                which[j], price[j], rows[j], pulled[j] = which[j + 1], price[j + 1], rows[j + 1], pulled[j + 1]
            price[k - 1] = price[k]
            k -= 1
        else:
            which[k], rows[k], pulled[k], active[p] = p, normal, whole, side
            k += 1
            p = -1
    return False


@njit(cache=True)
def _slopes(rows, pulled, whole):
    """Return how fast the prices of the active limits fall, and the step that leaves these limits as they are."""
    k, toward = len(rows), whole.copy()
    slopes, S, L = np.empty(k), np.empty((k, k)), np.zeros((k, k))
    for i in range(k):
        slopes[i] = (rows[i] * whole).sum()
        for j in range(k):
            S[i, j] = (rows[i] * pulled[j]).sum()
    if k > 0:
        cholesky(S, L)
        solve_lower(L, slopes, k)
        solve_upper(L, slopes, k)
        for i in range(k):
            toward -= slopes[i] * pulled[i]
    return slopes, toward


@njit(cache=True)
def _most_violated(C, low, high, x):
    """Return side (+1: the upper limit), row and size of the largest violation; row −1 without one."""
    side, p, worst = 0, -1, 0.0
    y = apply(C, x)
    for i in range(len(low)):
        if y[i] - high[i] > max(worst, _TOLERANCE * (1.0 + abs(high[i]))):
            side, p, worst = 1, i, y[i] - high[i]
        if low[i] - y[i] > max(worst, _TOLERANCE * (1.0 + abs(low[i]))):
            side, p, worst = -1, i, low[i] - y[i]
    return side, p, worst
