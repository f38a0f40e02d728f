"""The barrier 1/(d² − d_min²) of eq. (20), for one obstacle and for many at once; the pseudo-Huber cost of a pose."""

import math

from saphari_drake.compiled import njit

# Obstacles from which on the sums over them are taken without branches.
MANY = 16


@njit(cache=True, fastmath=True, error_model="numpy")
def barrier_sums(p_WO, radius, p, d_min, guard, sums):
    """Fill Σ 1/s, Σ 1/s², Σ d/s² and Σ ddᵀ/s³ over obstacles, s = d² − d_min² with d = p − p_O.

    Return how many s lie below `guard`; where none does, the sums are those with `barrier`. Without a branch several
    obstacles are worked on at once.
    """
    px, py, pz, below = p[0], p[1], p[2], 0.0
    f = w = wx = wy = wz = xx = yy = zz = xy = xz = yz = 0.0
    for o in range(radius.shape[0]):
        x, y, z, kept = px - p_WO[0, o], py - p_WO[1, o], pz - p_WO[2, o], d_min + radius[o]
        s = x * x + y * y + z * z - kept * kept
        below += 1.0 if s < guard else 0.0
        inv = 1.0 / s
        inv2 = inv * inv
        inv3 = inv2 * inv
        f += inv
        w += inv2
        wx += inv2 * x
        wy += inv2 * y
        wz += inv2 * z
        xx += inv3 * x * x
        yy += inv3 * y * y
        zz += inv3 * z * z
        xy += inv3 * x * y
        xz += inv3 * x * z
        yz += inv3 * y * z
    sums[0], sums[1], sums[2], sums[3], sums[4] = f, w, wx, wy, wz
    sums[5], sums[6], sums[7], sums[8], sums[9], sums[10] = xx, yy, zz, xy, xz, yz
    return below


@njit(cache=True)
def barrier(s, guard):
    """Return ψ, ψ' and ψ'' of the barrier 1/s, continued below `guard` by its quadratic expansion there."""
    if s >= guard:
        inv = 1.0 / s
        return inv, -inv * inv, 2.0 * inv * inv * inv
    inv = 1.0 / guard
    t = (s - guard) * inv
    return inv * (1.0 - t + t * t), inv * inv * (2.0 * t - 1.0), 2.0 * inv * inv * inv


@njit(cache=True)
def pseudo_huber(s, sigma):
    """Return φ = 2σ(√(1 + s/σ) − 1), φ' and φ'' (Charbonnier et al. 1994): s while s ≪ σ, then with the root of s.

    With σ = 0 it is s everywhere.
    """
    if sigma <= 0.0:
        return s, 1.0, 0.0
    root = math.sqrt(1.0 + s / sigma)
    return 2.0 * sigma * (root - 1.0), 1.0 / root, -0.5 / (sigma * root * root * root)
