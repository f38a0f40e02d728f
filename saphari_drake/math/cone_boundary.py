"""The boundary of a friction cone: its directions, and the one along which a quadratic is least."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from saphari_drake.compiled import njit

_ANGLES = 1152
_STEP = 2.0 * np.pi / _ANGLES  # rad
_ANGLE = _STEP * (np.arange(_ANGLES) - _ANGLES // 2)
_COS, _SIN = np.cos(_ANGLE), np.sin(_ANGLE)


class Boundary(NamedTuple):
    """dᵀb and dᵀHd on the boundary, of the directions d = a + μ(t cos θ + u sin θ): bᵀu is 0."""

    b0: float
    b1: float
    h00: float
    h01: float
    h02: float
    h11: float
    h12: float
    h22: float


@njit(cache=True)
def _form(x, H, y):
    """Return xᵀHy of a symmetric H."""
    total = 0.0
    for i in range(3):
        total += x[i] * (H[i, 0] * y[0] + H[i, 1] * y[1] + H[i, 2] * y[2])
    return total


@njit(cache=True)
def boundary(H, b, a, t, u, mu):
    """Return the `Boundary` of the cone round a with tangents t, u and the coefficient of friction mu."""
    return Boundary(
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
        mu * (t[0] * b[0] + t[1] * b[1] + t[2] * b[2]),
        _form(a, H, a),
        mu * _form(t, H, a),
        mu * _form(u, H, a),
        mu * mu * _form(t, H, t),
        mu * mu * _form(u, H, t),
        mu * mu * _form(u, H, u),
    )


@njit(cache=True)
def curvature(B, c, s):
    """Return dᵀHd at cosine and sine of an angle."""
    return B.h00 + 2.0 * (B.h01 * c + B.h02 * s) + B.h11 * c * c + 2.0 * B.h12 * c * s + B.h22 * s * s


@njit(cache=True)
def _slope(B, theta):
    """Derivative of (dᵀb)² / (dᵀHd) by the angle, up to a positive factor, where dᵀb > 0."""
    c, s = np.cos(theta), np.sin(theta)
    g, dg, h = B.b0 + B.b1 * c, -B.b1 * s, curvature(B, c, s)
    dh = 2.0 * (B.h02 * c - B.h01 * s) + 2.0 * (B.h22 - B.h11) * c * s + 2.0 * B.h12 * (c * c - s * s)
    return 2.0 * dg * h - g * dh


@njit(cache=True)
def best_angle(B, stride, width):
    """Return the angle within `width` of zero that maximizes (dᵀb)² / (dᵀHd), from every `stride`-th of the table."""
    best, angle = 0.0, 0.0
    for k in range(0, _ANGLES, stride):
        g = B.b0 + B.b1 * _COS[k]
        if g > 0.0:
            h = curvature(B, _COS[k], _SIN[k])
            if g * g > best * h:
                best, angle = g * g / h, _ANGLE[k]
    low, high = angle - stride * _STEP, angle + stride * _STEP
    if width < np.pi:
        low, high = max(low, -width), min(high, width)
    f_low, f_high = _slope(B, low), _slope(B, high)
    side = 0
    for _ in range(40 if f_low > 0.0 > f_high else 0):  # regula falsi, Illinois
        last = angle
        angle = (low * f_high - high * f_low) / (f_high - f_low)
        f = _slope(B, angle)
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
