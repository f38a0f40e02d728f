"""Forces at contacts whose sizes nobody knows beforehand: they are drawn from the residual itself.

A touch may be of 3 N or of 80 N, so that no usual size is expected but a usual shape: a force of size s along the
normal, which differs from it by a share of s. Sizes are weighed by the probability that they give to the residual
(empirical Bayes: H. Robbins 1956, D. MacKay 1992), all being equally likely in their logarithm, and the forces are
averaged with these weights.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.friction_cone import expected_forces_in_cones
from saphari_drake.math.products import cholesky, solve_lower

Array = NDArray[np.float64]

_MOST = 8  # combinations of sizes that are averaged
_FEW = 0.01  # weight, over the largest, below which a combination is left out


class UsualForce(NamedTuple):
    """What is known of a force beforehand."""

    sizes: Array  # (m,) N, all equally likely
    along: float  # deviation along the normal, over the size
    across: float  # deviation across it, over the size
    mu: float  # coefficient of friction


@njit(cache=True)
def size_costs(J, r, inward, sizes, along, across, sigma, point):
    """Return −2 log of the probability (m,) of a residual for each combination of sizes, and these sizes (m, k).

    Parameters
    ----------
    J, inward : (k, 3, n) and (k, 3) arrays
        Jacobians of one contact or two, and inward normals.
    r : (n,) array
        Residual (Nm).
    sizes, along, across : (s,) array, float, float
        As in `UsualForce`.
    sigma, point : (n,) arrays
        Deviations of the residual (Nm), and of each joint's lever arm (m).
    """
    k, n, s = J.shape[0], J.shape[2], sizes.shape[0]
    count = s if k == 1 else s * s
    cost, combination = np.empty(count), np.empty((count, k))
    mean, spread = np.zeros((k, n)), np.zeros((k, n, n))
    for c in range(k):
        for i in range(n):
            for a in range(3):
                mean[c, i] += J[c, a, i] * inward[c, a]
        for i in range(n):
            for j in range(n):
                total = 0.0
                for a in range(3):
                    total += J[c, a, i] * J[c, a, j]
                spread[c, i, j] = across**2 * total + (along**2 - across**2) * mean[c, i] * mean[c, j]
    V, L, e = np.empty((n, n)), np.zeros((n, n)), np.empty(n)
    for m in range(count):
        combination[m, 0] = sizes[m % s]
        if k == 2:
            combination[m, 1] = sizes[m // s]
        e[:], V[:] = r, 0.0
        squares = 0.0
        for c in range(k):
            size = combination[m, c]
            squares += size * size / k
            for i in range(n):
                e[i] -= size * mean[c, i]
                for j in range(n):
                    V[i, j] += size * size * spread[c, i, j]
        for i in range(n):
            V[i, i] += sigma[i] ** 2 + point[i] ** 2 * squares
        cost[m] = np.inf
        if cholesky(V, L):
            solve_lower(L, e, n)
            cost[m] = 0.0
            for i in range(n):
                cost[m] += e[i] * e[i] + 2.0 * np.log(L[i, i])
    return cost, combination


@njit(cache=True)
def forces_of_any_size(J, r, inward, usual, sigma, point):
    """Return the forces (k, 3) in N of one contact or two that explain a residual, in their cones.

    Parameters are those of `size_costs`, but for `usual`, a `UsualForce`.
    """
    k, n = J.shape[0], J.shape[2]
    cost, combination = size_costs(J, r, inward, usual.sizes, usual.along, usual.across, sigma, point)
    least = np.min(cost)
    weight = np.exp(-0.5 * (cost - least))
    order = np.argsort(cost)
    F, total, scaled = np.zeros((k, 3)), 0.0, np.empty((k, 3, n))
    for m in order[:_MOST]:
        if weight[m] < _FEW:
            break
        size, squares = combination[m], 0.0
        for c in range(k):
            squares += size[c] * size[c] / k
        deviation = np.sqrt(sigma**2 + point**2 * squares)
        for c in range(k):
            for a in range(3):
                scaled[c, a] = size[c] * J[c, a] / deviation
        shape, _ = expected_forces_in_cones(
            scaled, r / deviation, inward, inward, 1.0, usual.along, usual.across, usual.mu
        )
        for c in range(k):
            F[c] += weight[m] * size[c] * shape[c]
        total += weight[m]
    return F / total
