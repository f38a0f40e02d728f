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
from saphari_drake.math.products import apply, product, symmetric_eigen

Array = NDArray[np.float64]

_ANGLES = 1152
_STRIDES = (96, 8, 1)  # the search starts with 12 angles, and takes more where those miss a narrow valley
_STEP = 2.0 * np.pi / _ANGLES  # rad
_ANGLE = _STEP * (np.arange(_ANGLES) - _ANGLES // 2)
_COS, _SIN = np.cos(_ANGLE), np.sin(_ANGLE)
_RIDGE = 1e-6  # share of the largest eigenvalue of J Jᵀ; makes the solution unique


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
    norm = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    for i in range(3):
        t[i] /= norm
    u[0] = a[1] * t[2] - a[2] * t[1]
    u[1] = a[2] * t[0] - a[0] * t[2]
    u[2] = a[0] * t[1] - a[1] * t[0]


@njit(cache=True)
def _towards(b, a, t, u):
    """As `tangents`, with t along the tangential part of b if it has one."""
    along = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    for i in range(3):
        t[i] = b[i] - along * a[i]
    norm = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    if norm <= 1e-9 * abs(along):
        tangents(a, t, u)
        return
    for i in range(3):
        t[i] /= norm
    u[0] = a[1] * t[2] - a[2] * t[1]
    u[1] = a[2] * t[0] - a[0] * t[2]
    u[2] = a[0] * t[1] - a[1] * t[0]


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
def _slope(theta, b0, b1, h00, h01, h02, h11, h12, h22):
    """Derivative of (dᵀb)² / (dᵀHd) by the angle, up to a positive factor, where dᵀb > 0."""
    c, s = np.cos(theta), np.sin(theta)
    g, dg = b0 + b1 * c, -b1 * s
    h = h00 + 2.0 * (h01 * c + h02 * s) + h11 * c * c + 2.0 * h12 * c * s + h22 * s * s
    dh = 2.0 * (h02 * c - h01 * s) + 2.0 * (h22 - h11) * c * s + 2.0 * h12 * (c * c - s * s)
    return 2.0 * dg * h - g * dh


@njit(cache=True)
def _best_angle(stride, width, b0, b1, h00, h01, h02, h11, h12, h22):
    """Return the angle within `width` of zero that maximizes (dᵀb)² / (dᵀHd), from every `stride`-th of the table."""
    best, angle = 0.0, 0.0
    for k in range(0, _ANGLES, stride):
        c, s = _COS[k], _SIN[k]
        g = b0 + b1 * c
        if g > 0.0:
            h = h00 + 2.0 * (h01 * c + h02 * s) + h11 * c * c + 2.0 * h12 * c * s + h22 * s * s
            if g * g > best * h:
                best, angle = g * g / h, _ANGLE[k]
    low, high = angle - stride * _STEP, angle + stride * _STEP
    if width < np.pi:
        low, high = max(low, -width), min(high, width)
    f_low = _slope(low, b0, b1, h00, h01, h02, h11, h12, h22)
    f_high = _slope(high, b0, b1, h00, h01, h02, h11, h12, h22)
    side = 0
    for _ in range(40 if f_low > 0.0 > f_high else 0):  # regula falsi, Illinois
        last = angle
        angle = (low * f_high - high * f_low) / (f_high - f_low)
        f = _slope(angle, b0, b1, h00, h01, h02, h11, h12, h22)
        if abs(angle - last) < 1e-10:
            break
        if f > 0.0:
            low, f_low = angle, f
            f_high = 0.5 * f_high if side == 1 else f_high
            side = 1
        else:
            high, f_high = angle, f
            f_low = 0.5 * f_low if side == -1 else f_low
            side = -1
    return angle


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
    Ha, Ht = np.empty(3), np.empty(3)
    b0 = b1 = h00 = h01 = h02 = h11 = h12 = h22 = 0.0
    for i in range(3):
        b0 += a[i] * b[i]
        b1 += t[i] * b[i]
        Ha[i] = H[i, 0] * a[0] + H[i, 1] * a[1] + H[i, 2] * a[2]
        Ht[i] = H[i, 0] * t[0] + H[i, 1] * t[1] + H[i, 2] * t[2]
    for i in range(3):
        h00 += a[i] * Ha[i]
        h01 += t[i] * Ha[i]
        h02 += u[i] * Ha[i]
        h11 += t[i] * Ht[i]
        h12 += u[i] * Ht[i]
        h22 += u[i] * (H[i, 0] * u[0] + H[i, 1] * u[1] + H[i, 2] * u[2])
    F[0] = F[1] = F[2] = 0.0
    b1, h01, h02, h11, h12, h22 = mu * b1, mu * h01, mu * h02, mu * mu * h11, mu * mu * h12, mu * mu * h22
    if b0 + b1 <= 0.0:
        return 0.0
    # dᵀb = b0 + b1 cos θ is positive within `width` of θ = 0.
    width = np.arccos(max(-b0 / b1, -1.0)) if b1 > 0.0 else np.pi
    for stride in _STRIDES:
        angle = _best_angle(stride, width, b0, b1, h00, h01, h02, h11, h12, h22)
        c, s = np.cos(angle), np.sin(angle)
        g = b0 + b1 * c
        f = g / (h00 + 2.0 * (h01 * c + h02 * s) + h11 * c * c + 2.0 * h12 * c * s + h22 * s * s)
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
    """Return J Jᵀ without the directions whose singular value is below `rcond` of the largest, plus a tiny ridge."""
    values, U = symmetric_eigen(product(J, J.T))
    H = np.zeros((3, 3))
    kept = np.zeros((3, 3))
    for k in range(3):
        if values[k] > rcond * rcond * values[2] and values[k] > 1e-18:
            for i in range(3):
                for j in range(3):
                    H[i, j] += values[k] * U[i, k] * U[j, k]
                    kept[i, j] += U[i, k] * U[j, k]
    for i in range(3):
        H[i, i] += max(_RIDGE * values[2], 1e-18)
    return H, kept


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
def expected_forces_in_cones(J, r, inward, mean, sigma, along, across, mu, rounds=80):
    """Return the forces (k, 3) of k contacts that explain the residual together, each in its cone, and the misfit.

    They minimize ‖r − Σ JᵀF‖² / σ² + Σ ‖F − F_mean‖², the latter in deviations `along` and `across` the normals: what
    the residual does not show of a force stays as expected. The convex problem is solved by turns, one force with the
    others held, until they change by less than 1 mN.

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
    count, n = J.shape[0], r.shape[0]
    H, held = np.empty((count, 3, 3)), np.empty((count, 3))
    F, rest, b = mean.copy(), r.copy(), np.empty(3)
    for k in range(count):
        H[k] = product(J[k], J[k].T)
        for i in range(3):
            for j in range(3):
                normal = inward[k, i] * inward[k, j]
                unit = 1.0 if i == j else 0.0
                H[k, i, j] += sigma**2 * (normal / along**2 + (unit - normal) / across**2)
        for i in range(3):
            held[k, i] = 0.0
            for j in range(3):
                normal = inward[k, i] * inward[k, j]
                unit = 1.0 if i == j else 0.0
                held[k, i] += sigma**2 * (normal / along**2 + (unit - normal) / across**2) * mean[k, j]
        for j in range(n):
            rest[j] -= J[k, 0, j] * F[k, 0] + J[k, 1, j] * F[k, 1] + J[k, 2, j] * F[k, 2]
    last = np.empty(3)
    for _ in range(rounds):
        change = 0.0
        for k in range(count):
            last[:] = F[k]
            for i in range(3):
                b[i] = held[k, i]
                for j in range(n):
                    torque = J[k, 0, j] * last[0] + J[k, 1, j] * last[1] + J[k, 2, j] * last[2]
                    b[i] += J[k, i, j] * (rest[j] + torque)
            cone_minimum(H[k], b, inward[k], mu, F[k])
            for j in range(n):
                for i in range(3):
                    rest[j] -= J[k, i, j] * (F[k, i] - last[i])
            for i in range(3):
                change = max(change, abs(F[k, i] - last[i]))
        if change < 1e-3:
            break
    misfit = 0.0
    for j in range(n):
        misfit += rest[j] * rest[j]
    return F, misfit / sigma**2
