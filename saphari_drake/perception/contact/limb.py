"""What a camera sees of a limb tells where its far side touches: a round limb is fitted to the person's readings.

The camera sees the near side of a forearm, a fist or the flat of a hand, and the contact lies behind it. The readings
around the person's nearest place are fitted by a cylinder of unknown axis and radius, and the contact is where that
axis comes nearest to the robot: over a part of its length, as the centre of that part, or at its end.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.friction_cone import tangents
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.math.products import cholesky, solve_lower, solve_upper, symmetric_eigen

_ROUNDS = 12
_PRIOR = 0.003  # weight of the first radius, as a share of all readings
_LEAST, _MOST = 0.004, 0.08  # m, radii
_SCALE = 0.004  # m, distance from the cylinder that counts as noise at least
_SAMPLES = 41  # points of the axis
_BEYOND = 0.03  # m, how far the axis may go on where no more of it is seen


class Limb(NamedTuple):
    """A cylinder in C."""

    c: NDArray[np.float64]  # (3,) m, point of the axis
    u: NDArray[np.float64]  # (3,) unit direction of the axis
    radius: float  # m
    first: float  # m, extent of the readings along the axis from c
    last: float


@njit(cache=True)
def readings_around(point, p, radius, most):
    """Return up to about `most` of the points (k, 3) within `radius` (m) of p (3,), evenly taken."""
    near = point[np.sum((point - p) ** 2, axis=1) < radius * radius]
    return near[:: near.shape[0] // most + 1].copy()


@njit(cache=True)
def fit_limb(point):
    """Return the `Limb` that fits readings (k, 3) in C (m) of its near side.

    Starts with the axis of largest extent, behind the readings by their own breadth, and takes robust Gauss–Newton
    steps: a reading at distance e from the cylinder has weight 1 / (1 + (e / s)²), s being 4 mm or 1.2 times the mean
    of |e|. A weak prior holds the radius near the breadth where the readings do not tell.
    """
    count = point.shape[0]
    mean = np.sum(point, axis=0) / count
    off, scatter = point - mean, np.empty((3, 3))
    for m in range(3):
        for l in range(3):
            scatter[m, l] = np.sum(off[:, m] * off[:, l]) / count
    values, U = symmetric_eigen(scatter)
    u = U[:, 2].copy()
    radius = start = min(max(1.6 * np.sqrt(max(values[1], 0.0)), 1.5 * _LEAST), 0.05)
    c = mean * (1.0 + 0.7 * start / np.sqrt(np.sum(mean * mean)))
    t, v, error, scale = np.empty(3), np.empty(3), np.zeros(count), _SCALE
    for _ in range(_ROUNDS):
        tangents(u, t, v)
        error, slope = _errors(point, c, u, t, v, radius)
        scale = max(_SCALE, 1.2 * np.sum(np.abs(error)) / count)
        step = _step(error, slope, scale, start - radius)
        a, b = min(max(step[0], -0.02), 0.02), min(max(step[1], -0.02), 0.02)
        turn_t, turn_v = min(max(step[2], -0.3), 0.3), min(max(step[3], -0.3), 0.3)
        c += a * t + b * v
        u += turn_t * t + turn_v * v
        u /= np.sqrt(np.sum(u * u))
        radius = min(max(radius + step[4], _LEAST), _MOST)
        if abs(a) + abs(b) + abs(step[4]) + 0.05 * (abs(turn_t) + abs(turn_v)) < 1e-4:
            break
    first, last = np.inf, -np.inf
    for i in range(count):
        if abs(error[i]) < 3.0 * scale:
            along = (point[i, 0] - c[0]) * u[0] + (point[i, 1] - c[1]) * u[1] + (point[i, 2] - c[2]) * u[2]
            first, last = min(first, along), max(last, along)
    return Limb(c, u, radius, first, last)


@njit(cache=True)
def _errors(point, c, u, t, v, radius):
    """Return distances (k,) of points from a cylinder, and how they fall with its shift, turn and radius (k, 5)."""
    count = point.shape[0]
    error, slope = np.empty(count), np.ones((count, 5))
    for i in range(count):
        x, y, z = point[i, 0] - c[0], point[i, 1] - c[1], point[i, 2] - c[2]
        along = x * u[0] + y * u[1] + z * u[2]
        x, y, z = x - along * u[0], y - along * u[1], z - along * u[2]
        d = max(np.sqrt(x * x + y * y + z * z), 1e-9)
        error[i] = d - radius
        slope[i, 0] = (x * t[0] + y * t[1] + z * t[2]) / d
        slope[i, 1] = (x * v[0] + y * v[1] + z * v[2]) / d
        slope[i, 2], slope[i, 3] = along * slope[i, 0], along * slope[i, 1]
    return error, slope


@njit(cache=True)
def _step(error, slope, scale, missing):
    """Return the Gauss–Newton step (5,), or zero; `missing` (m) is how far the radius lies below its prior."""
    A, L, g = np.zeros((5, 5)), np.zeros((5, 5)), np.zeros(5)
    for i in range(error.shape[0]):
        weight = 1.0 / (1.0 + (error[i] / scale) ** 2)
        for m in range(5):
            g[m] += weight * slope[i, m] * error[i]
            for l in range(m + 1):
                A[m, l] += weight * slope[i, m] * slope[i, l]
    A[4, 4] += _PRIOR * error.shape[0]
    g[4] += _PRIOR * error.shape[0] * missing
    trace = A[0, 0] + A[1, 1] + A[2, 2] + A[3, 3] + A[4, 4]
    for m in range(5):
        A[m, m] += 1e-9 * trace
        for l in range(m):
            A[l, m] = A[m, l]
    if not cholesky(A, L):
        return np.zeros(5)
    solve_lower(L, g, 5)
    solve_upper(L, g, 5)
    return g


@njit(cache=True)
def _nearest(shapes, p):
    """Return link, distance (m) and surface point (3,) of the moving shape nearest to p (3,); link −1 without one."""
    s, distance, surface, _ = nearest_surface_point(shapes.kind, shapes.size, shapes.R, shapes.p, shapes.link >= 0, p)
    return (shapes.link[s] if s >= 0 else np.int64(-1)), distance, surface


@njit(cache=True)
def limb_contact(shapes, limb, softness):
    """Return link, surface point (3,) in C and distance (m) from the axis, where a limb comes nearest to the robot.

    Along the side it is the mean of the surface points under the axis with weights max(`softness` − d + d_least, 0):
    the soft limb presses there. At the end of what is seen, a ball of the limb's radius goes on along the axis until it
    touches, or comes no nearer.
    """
    c, u, radius, first, last = limb
    d, on, under = np.empty(_SAMPLES), np.empty(_SAMPLES, np.int64), np.empty((_SAMPLES, 3))
    step = (last - first) / (_SAMPLES - 1)
    for i in range(_SAMPLES):
        on[i], d[i], under[i] = _nearest(shapes, c + (first + i * step) * u)
    best = np.argmin(d)
    if 0 < best < _SAMPLES - 1:
        weight = np.where(on == on[best], np.maximum(softness - d + d[best], 0.0), 0.0)
        mean = np.zeros(3)
        for i in range(_SAMPLES):
            mean += weight[i] * under[i]
        return on[best], mean / np.sum(weight), d[best]
    outward = -1.0 if best == 0 else 1.0
    at = (first if best == 0 else last) - outward * radius
    far = at + outward * (radius + _BEYOND)
    found, gap, touched = np.int64(-1), np.inf, np.zeros(3)
    for _ in range(40):
        link, here, surface = _nearest(shapes, c + at * u)
        if here >= gap:
            break
        found, gap, touched = link, here, surface
        if gap - radius < 1e-4 or (far - at) * outward <= 0.0:
            break
        at += outward * min(max(gap - radius, 5e-4), (far - at) * outward)
    return found, touched, gap
