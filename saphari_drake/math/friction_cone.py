"""The force at a contact that explains a residual best and lies inside the friction cone.

A person pushes, and friction bounds how far the force leans: F = f (a + t), with a the inward normal, t tangential,
‖t‖ ≤ μ and f ≥ 0. The least squares min ‖r − JᵀF‖² over that cone is convex. Its solution is the free minimum if that
lies inside, zero if no force of the cone helps, and otherwise lies on the boundary, where only the angle of t is left
to find.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.cone_boundary import best_angle, boundary, curvature
from saphari_drake.math.products import apply, product, symmetric_eigen

Array = NDArray[np.float64]

_STRIDES = (96, 8, 1)  # the search starts with 12 angles, and takes more where those miss a narrow valley
_ROUNDS = 80  # of `expected_forces_in_cones`
_RIDGE = 1e-6  # share of the largest eigenvalue of J Jᵀ; makes the solution unique


@njit(cache=True)
def _complete(a, t, u):
    """Make t a unit vector, and fill u so that a, t, u are a right-handed frame."""
    norm = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    for i in range(3):
        t[i] /= norm
    u[0] = a[1] * t[2] - a[2] * t[1]
    u[1] = a[2] * t[0] - a[0] * t[2]
    u[2] = a[0] * t[1] - a[1] * t[0]


@njit(cache=True)
def tangents(a, t, u):
    """Fill t and u with unit vectors that make a right-handed frame with the unit vector a."""
    k = 0
    for i in range(1, 3):
        if abs(a[i]) < abs(a[k]):
            k = i
    for i in range(3):
        t[i] = -a[k] * a[i]
    t[k] += 1.0
    _complete(a, t, u)


@njit(cache=True)
def _towards(b, a, t, u):
    """As `tangents`, with t along the tangential part of b if it has one."""
    along = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    for i in range(3):
        t[i] = b[i] - along * a[i]
    if np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) <= 1e-9 * abs(along):
        tangents(a, t, u)
    else:
        _complete(a, t, u)


@njit(cache=True)
def solve3(H, b, x):
    """Fill x with H⁻¹ b of a symmetric positive definite 3×3 matrix; return det H."""
    c00 = H[1, 1] * H[2, 2] - H[1, 2] * H[1, 2]
    c01 = H[0, 2] * H[1, 2] - H[0, 1] * H[2, 2]
    c02 = H[0, 1] * H[1, 2] - H[0, 2] * H[1, 1]
    c11 = H[0, 0] * H[2, 2] - H[0, 2] * H[0, 2]
    c12 = H[0, 1] * H[0, 2] - H[0, 0] * H[1, 2]
    c22 = H[0, 0] * H[1, 1] - H[0, 1] * H[0, 1]
    det = H[0, 0] * c00 + H[0, 1] * c01 + H[0, 2] * c02
    x[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / det
    x[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / det
    x[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / det
    return det


@njit(cache=True)
def cone_minimum(H, b, a, mu, F):
    """Fill F with the minimum of FᵀHF − 2bᵀF over the friction cone; return that minimum.

    Parameters
    ----------
    H : (3, 3) array
        Symmetric, positive definite.
    b : (3,) array
    a : (3,) array
        Axis of the cone: unit vector into the body that is pushed.
    mu : float
        Coefficient of friction (≥ 0).
    F : (3,) array
        Filled with the force.
    """
    solve3(H, b, F)
    along = F[0] * a[0] + F[1] * a[1] + F[2] * a[2]
    if along > 0.0 and F[0] * F[0] + F[1] * F[1] + F[2] * F[2] <= (1.0 + mu * mu) * along * along:
        return -(F[0] * b[0] + F[1] * b[1] + F[2] * b[2])
    t, u = np.empty(3), np.empty(3)
    _towards(b, a, t, u)
    B = boundary(H, b, a, t, u, mu)
    F[0] = F[1] = F[2] = 0.0
    if B.b0 + B.b1 <= 0.0:
        return 0.0
    # dᵀb = b0 + b1 cos θ is positive within `width` of θ = 0.
    width = np.arccos(max(-B.b0 / B.b1, -1.0)) if B.b1 > 0.0 else np.pi
    for stride in _STRIDES:
        angle = best_angle(B, stride, width)
        c, s = np.cos(angle), np.sin(angle)
        g = B.b0 + B.b1 * c
        f = g / curvature(B, c, s)
        for i in range(3):
            F[i] = f * (a[i] + mu * (c * t[i] + s * u[i]))
        # At the minimum the slope HF − b is normal to the cone and points into it; at other stationary points, out.
        inside, across, size = 0.0, 0.0, 0.0
        for i in range(3):
            slope = H[i, 0] * F[0] + H[i, 1] * F[1] + H[i, 2] * F[2] - b[i]
            inside += slope * (mu * a[i] - (c * t[i] + s * u[i]))
            across += slope * (c * u[i] - s * t[i])
            size += b[i] * b[i]
        if inside >= 0.0 and across * across <= 1e-10 * size:
            break
    return -f * g


@njit(cache=True)
def _truncated(J, rcond):
    """Return J Jᵀ without the directions whose singular value is below `rcond` of the largest, plus a tiny ridge.

    Also the projector on those that are kept.
    """
    values, U = symmetric_eigen(product(J, J.T))
    keep = np.where(values > max(rcond * rcond * values[2], 1e-18), 1.0, 0.0)
    H = product(U * (keep * values), U.T) + max(_RIDGE * values[2], 1e-18) * np.eye(3)
    return H, product(U * keep, U.T)


@njit(cache=True)
def force_in_cone(J, r, inward, mu, rcond):
    """Return the contact force F (3,) that minimizes ‖r − JᵀF‖ inside the friction cone, eq. (51) with a bound.

    Directions in which the Jacobian is weak are left out of the least squares. A force along them makes no torque that
    counts, so there F is only as large as the cone demands: near the shoulder it is the least pressure that could hold
    the friction seen.

    Parameters
    ----------
    J : (3, n) array
        Jacobian of the contact point.
    r : (n,) array
        Residual, r ≈ JᵀF (Nm).
    inward : (3,) array
        Unit normal into the robot, in the Jacobian's frame.
    mu : float
        Coefficient of friction (≥ 0); ∞ is not allowed.
    rcond : float
        Share of the largest singular value of J below which a direction is left out.
    """
    H, kept = _truncated(J, rcond)
    F = np.zeros(3)
    cone_minimum(H, apply(kept, apply(J, r)), inward, mu, F)
    return F


@njit(cache=True)
def expected_forces_in_cones(J, r, inward, mean, sigma, along, across, mu):
    """Return the forces (k, 3) of k contacts that explain the residual together, each in its cone, and the misfit.

    They minimize ‖r − Σ JᵀF‖² / σ² + Σ ‖F − F_mean‖², the latter in deviations along and across the normals: what the
    residual does not show of a force stays as expected. The convex problem is solved by turns, one force with the
    others held, until they change by less than 1 mN, or for 80 rounds.

    Parameters
    ----------
    J : (k, 3, n) array
        Jacobians of the contact points.
    r : (n,) array
        Residual (Nm), and `sigma` (float) the deviation of each joint's.
    inward, mean : (k, 3) arrays
        Unit normals into the robot, and the forces that are expected (N).
    along, across : float
        Deviations of a force from what is expected (N), along the normal and across it.
    mu : float
        Coefficient of friction (≥ 0).

    Returns
    -------
    F : (k, 3) array
        N.
    misfit : float
        ‖r − Σ JᵀF‖² / σ².
    """
    count = J.shape[0]
    H, held, F, rest = np.empty((count, 3, 3)), np.empty((count, 3)), mean.copy(), r.copy()
    beside = (sigma / across) ** 2
    more = (sigma / along) ** 2 - beside
    for k in range(count):
        expected = beside * np.eye(3) + more * np.outer(inward[k], inward[k])
        H[k], held[k] = product(J[k], J[k].T) + expected, apply(expected, mean[k])
        rest -= apply(J[k].T, F[k])
    for _ in range(_ROUNDS):
        change = 0.0
        for k in range(count):
            last = F[k].copy()
            rest += apply(J[k].T, last)
            cone_minimum(H[k], held[k] + apply(J[k], rest), inward[k], mu, F[k])
            rest -= apply(J[k].T, F[k])
            change = max(change, np.abs(F[k] - last).max())
        if change < 1e-3:
            break
    return F, np.sum(rest * rest) / sigma**2
