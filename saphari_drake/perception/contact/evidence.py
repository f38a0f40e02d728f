"""The compiled passes of the contact fusion: what residual and cameras say about points of the robot's surface.

All costs are −2 log of a likelihood, so that they add up; points and vectors are in the world.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.friction_cone import cone_minimum, solve3, tangents

Array = NDArray[np.float64]

# Candidates whose free least squares costs so much more than the best one's, or than that of so many others, decide
# nothing: their cone is left out.
_NARROW = 60.0
_MOST = 200
# A point above the surface is seen to be free if the reading along its ray lies more than this behind it (m).
_MARGIN = 0.03
LIFTS = (0.006, 0.012, 0.018)  # m, heights of these points


class ForceModel(NamedTuple):
    """What a residual and a force usually are."""

    sigma: float  # Nm, deviation of the residual of each joint
    force: float  # N, size of a usual force
    mu: float  # coefficient of friction
    cell: float  # m, deviation of the true point from the one that stands for it
    across: float = 1.0  # size of a usual force across the normal, over that along it


class Work(NamedTuple):
    """Scratch of the passes, and what they leave there."""

    H: NDArray[np.float64]  # (3, 3)
    b: NDArray[np.float64]  # (3,)
    F: NDArray[np.float64]  # (3,) N


@njit(cache=True)
def work():
    """Return empty scratch."""
    return Work(np.empty((3, 3)), np.empty(3), np.empty(3))


@njit(cache=True)
def free_cost(parent, S, link, p, a, r, model, work):
    """Fill H, b and F of `touch_cost` without the cone; return rᵀr, the cost and its part log det(W⁻¹ H)."""
    sigma, (H, b, F) = model.sigma, work
    h00 = h01 = h02 = h11 = h12 = h22 = b0 = b1 = b2 = rr = 0.0
    for j in range(r.shape[0]):
        rr += r[j] * r[j]
    j = link
    while j >= 0:
        x = S[j, 3] + S[j, 1] * p[2] - S[j, 2] * p[1]
        y = S[j, 4] + S[j, 2] * p[0] - S[j, 0] * p[2]
        z = S[j, 5] + S[j, 0] * p[1] - S[j, 1] * p[0]
        h00, h01, h02 = h00 + x * x, h01 + x * y, h02 + x * z
        h11, h12, h22 = h11 + y * y, h12 + y * z, h22 + z * z
        b0, b1, b2 = b0 + x * r[j], b1 + y * r[j], b2 + z * r[j]
        j = parent[j]
    along = (sigma / model.force) ** 2
    ridge = along / model.across**2
    k = along - ridge
    H[0, 0], H[1, 1] = h00 + ridge + k * a[0] * a[0], h11 + ridge + k * a[1] * a[1]
    H[2, 2] = h22 + ridge + k * a[2] * a[2]
    H[0, 1], H[0, 2], H[1, 2] = h01 + k * a[0] * a[1], h02 + k * a[0] * a[2], h12 + k * a[1] * a[2]
    H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
    b[0], b[1], b[2] = b0, b1, b2
    spread = np.log(max(solve3(H, b, F), 1e-300)) - 2.0 * np.log(ridge) - np.log(along)
    return rr, (rr - F[0] * b0 - F[1] * b1 - F[2] * b2) / (sigma * sigma) + spread, spread


@njit(cache=True)
def touch_cost(parent, S, link, p, inward, r, model, work):
    """Return misfit and spread of a contact at p, whose sum is its cost, and fill F (3,) with its force (N).

    With J the Jacobian of p, f the size of a usual force, W = (σ / f)² along the normal and more across it, and
    H = J Jᵀ + W, F minimizes the misfit (‖r − JᵀF‖² + FᵀWF) / σ² inside the friction cone. The spread log det(W⁻¹ H)
    weighs how exactly F has to be chosen. Both allow for the true point lying within `cell` (m) of p on the surface.

    Parameters
    ----------
    parent, S : (n,) int array and (n, 6) array
        Tree and joint axes.
    link, p, inward : int, (3,) and (3,) arrays
        The contact (m) and the inward normal there.
    r : (n,) array
        Residual (Nm).
    model : ForceModel
    work : Work
        Left with H, J r and F.
    """
    rr, _, spread = free_cost(parent, S, link, p, inward, r, model, work)
    sigma, cell, (H, b, F) = model.sigma, model.cell, work
    misfit = (rr + cone_minimum(H, b, inward, model.mu, F)) / (sigma * sigma)
    if cell > 0.0:
        t, u = np.empty(3), np.empty(3)
        tangents(inward, t, u)
        k = (sigma / cell) ** 2
        d00, d01, d11, e0, e1 = k, 0.0, k, 0.0, 0.0
        j = link
        while j >= 0:
            # Torque j of F at p, and what a shift δ of the point changes in it: F · (ω × δ) = δ · (F × ω).
            e = r[j] - F[0] * (S[j, 3] + S[j, 1] * p[2] - S[j, 2] * p[1])
            e -= F[1] * (S[j, 4] + S[j, 2] * p[0] - S[j, 0] * p[2]) + F[2] * (S[j, 5] + S[j, 0] * p[1] - S[j, 1] * p[0])
            x = F[1] * S[j, 2] - F[2] * S[j, 1]
            y = F[2] * S[j, 0] - F[0] * S[j, 2]
            z = F[0] * S[j, 1] - F[1] * S[j, 0]
            s0, s1 = x * t[0] + y * t[1] + z * t[2], x * u[0] + y * u[1] + z * u[2]
            d00 += s0 * s0
            d01 += s0 * s1
            d11 += s1 * s1
            e0 += s0 * e
            e1 += s1 * e
            j = parent[j]
        inner = d00 * d11 - d01 * d01
        misfit -= (d11 * e0 * e0 - 2.0 * d01 * e0 * e1 + d00 * e1 * e1) / inner / (sigma * sigma)
        spread += np.log(inner / (k * k))
    return misfit, spread


@njit(cache=True)
def pose_points(link, p_L, n_L, R_WL, p_WL):
    """Return points p (m, 3) and inward normals a (m, 3) in the world."""
    m = link.shape[0]
    p, a = np.empty((m, 3)), np.empty((m, 3))
    for c in range(m):
        R, o = R_WL[link[c]], p_WL[link[c]]
        for i in range(3):
            p[c, i] = o[i] + R[i, 0] * p_L[c, 0] + R[i, 1] * p_L[c, 1] + R[i, 2] * p_L[c, 2]
            a[c, i] = -(R[i, 0] * n_L[c, 0] + R[i, 1] * n_L[c, 1] + R[i, 2] * n_L[c, 2])
    return p, a


@njit(cache=True)
def residual_costs(parent, S, link, p, a, r, model):
    """Return misfit (m,) and spread (m,) of every candidate; a lower bound where their sum is far above the least."""
    m = link.shape[0]
    cost, misfit, spread, scratch = np.empty(m), np.empty(m), np.empty(m), work()
    for c in range(m):
        _, cost[c], spread[c] = free_cost(parent, S, link[c], p[c], a[c], r, model, scratch)
        misfit[c] = cost[c] - spread[c]
    bound = cost.min() + _NARROW
    if m > _MOST:
        bound = min(bound, np.partition(cost, _MOST)[_MOST])
    for c in range(m):
        if cost[c] < bound:
            misfit[c], spread[c] = touch_cost(parent, S, link[c], p[c], a[c], r, model, scratch)
    return misfit, spread


@njit(cache=True)
def best_apart(cost, p, count, more, apart):
    """Return the indices of `count` candidates p (m, 3) of least cost that lie `apart` (m) from one another.

    And of all others of which the cost is less than `more` above the least.
    """
    chosen: list[int] = []
    left, next_best = cost.copy(), int(np.argmin(cost))
    most = cost[next_best] + more
    while np.isfinite(left[next_best]) and (len(chosen) < count or left[next_best] < most):
        i = next_best
        chosen.append(i)
        left[i] = np.inf
        for k in range(len(left)):
            if left[k] < np.inf:
                if (p[k, 0] - p[i, 0]) ** 2 + (p[k, 1] - p[i, 1]) ** 2 + (p[k, 2] - p[i, 2]) ** 2 < apart * apart:
                    left[k] = np.inf
                elif left[k] < left[next_best]:
                    next_best = k
    return chosen


@njit(cache=True, fastmath={"contract", "nsz", "arcp", "reassoc"})
def nearest_distances(p, a, lift, x, y, z):
    """Return the distance (m,) of each candidate, lifted off the surface by `lift` (m), to the points x, y, z (k,)."""
    m, k = p.shape[0], x.shape[0]
    out = np.empty(m)
    for c in range(m):
        px = np.float32(p[c, 0] - lift * a[c, 0])
        py = np.float32(p[c, 1] - lift * a[c, 1])
        pz = np.float32(p[c, 2] - lift * a[c, 2])
        best = np.float32(1e6)
        for i in range(k):
            dx, dy, dz = x[i] - px, y[i] - py, z[i] - pz
            d = dx * dx + dy * dy + dz * dz
            best = d if d < best else best
        out[c] = np.sqrt(best)
    return out


@njit(cache=True)
def share_free(p, a, depth, pinhole, R_WC, p_WC):
    """Return the share (m,) of the points above each candidate, at heights `LIFTS`, through which a camera sees.

    No reading tells nothing.
    """
    rows, cols = depth.shape
    free = np.empty(p.shape[0])
    for k in range(p.shape[0]):
        seen = 0
        for lift in LIFTS:
            x = p[k, 0] - lift * a[k, 0] - p_WC[0]
            y = p[k, 1] - lift * a[k, 1] - p_WC[1]
            z = p[k, 2] - lift * a[k, 2] - p_WC[2]
            zc = R_WC[0, 2] * x + R_WC[1, 2] * y + R_WC[2, 2] * z
            if zc <= 0.0:
                continue
            c = int(np.floor((R_WC[0, 0] * x + R_WC[1, 0] * y + R_WC[2, 0] * z) / zc * pinhole.fx + pinhole.cx))
            r = int(np.floor((R_WC[0, 1] * x + R_WC[1, 1] * y + R_WC[2, 1] * z) / zc * pinhole.fy + pinhole.cy))
            if 0 <= c < cols and 0 <= r < rows:
                d = depth[r, c]
                if d > zc + _MARGIN and d > 0.0:
                    seen += 1
        free[k] = seen / len(LIFTS)
    return free
