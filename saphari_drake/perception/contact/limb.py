"""What a camera sees of a limb tells where its far side touches: a round limb is fitted to the person's readings.

The camera sees the near side of a forearm, a fist or the flat of a hand, and the contact lies behind it. The readings
around the person's nearest place are fitted by a cylinder of unknown axis and radius, and the contact is where that
axis comes nearest to the robot: over a part of its length, as the centre of that part, or at its end.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.friction_cone import tangents
from saphari_drake.math.primitives import surface_point_local
from saphari_drake.math.products import cholesky, solve_lower, solve_upper, symmetric_eigen

_ROUNDS = 12
_PRIOR = 0.003  # weight of the first radius, as a share of all readings
_LEAST, _MOST = 0.004, 0.08  # m, radii
_SCALE = 0.004  # m, distance from the cylinder that counts as noise at least
_SAMPLES = 41  # points of the axis
_BEYOND = 0.03  # m, how far the axis may go on where no more of it is seen


@njit(cache=True)
def readings_around(point, p, radius, most):
    """Return up to about `most` of the points (k, 3) within `radius` (m) of p (3,), evenly taken."""
    count = 0
    for i in range(point.shape[0]):
        a, b, c = point[i, 0] - p[0], point[i, 1] - p[1], point[i, 2] - p[2]
        count += a * a + b * b + c * c < radius * radius
    stride = count // most + 1
    out = np.empty((count // stride + 1, 3))
    k = taken = 0
    for i in range(point.shape[0]):
        a, b, c = point[i, 0] - p[0], point[i, 1] - p[1], point[i, 2] - p[2]
        if a * a + b * b + c * c < radius * radius:
            if k % stride == 0:
                out[taken] = point[i]
                taken += 1
            k += 1
    return out[:taken]


@njit(cache=True)
def fit_limb(point):
    """Fit a cylinder to readings (k, 3) in C (m) of its near side.

    Starts with the axis of largest extent, behind the readings by their own breadth, and takes robust Gauss–Newton
    steps: a reading at distance e from the cylinder has weight 1 / (1 + (e / s)²), s being 4 mm or 1.2 times the mean
    of |e|. A weak prior holds the radius near the breadth where the readings do not tell.

    Returns
    -------
    c, u : (3,) arrays
        Point (m) and unit direction of the axis.
    radius : float
        m.
    first, last : float
        Extent of the readings along the axis from c (m).
    """
    count = point.shape[0]
    mean, scatter = np.zeros(3), np.zeros((3, 3))
    for i in range(count):
        for m in range(3):
            mean[m] += point[i, m] / count
    for i in range(count):
        for m in range(3):
            for l in range(3):
                scatter[m, l] += (point[i, m] - mean[m]) * (point[i, l] - mean[l]) / count
    values, U = symmetric_eigen(scatter)
    u = U[:, 2].copy()
    start = min(max(1.6 * np.sqrt(max(values[1], 0.0)), 1.5 * _LEAST), 0.05)
    away = np.sqrt(mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2)
    c = mean * (1.0 + 0.7 * start / away)
    radius, before = start, 0.0
    t, v, g, row = np.empty(3), np.empty(3), np.empty(5), np.empty(5)
    A, L, error, side = np.empty((5, 5)), np.zeros((5, 5)), np.empty(count), np.empty((count, 4))
    for _ in range(_ROUNDS):
        tangents(u, t, v)
        before = 0.0
        for i in range(count):
            x, y, z = point[i, 0] - c[0], point[i, 1] - c[1], point[i, 2] - c[2]
            along = x * u[0] + y * u[1] + z * u[2]
            x, y, z = x - along * u[0], y - along * u[1], z - along * u[2]
            d = max(np.sqrt(x * x + y * y + z * z), 1e-9)
            error[i] = d - radius
            before += abs(error[i]) / count
            side[i, 0] = (x * t[0] + y * t[1] + z * t[2]) / d
            side[i, 1] = (x * v[0] + y * v[1] + z * v[2]) / d
            side[i, 2], side[i, 3] = along * side[i, 0], along * side[i, 1]
        scale = max(_SCALE, 1.2 * before)
        A[:], g[:] = 0.0, 0.0
        for i in range(count):
            weight = 1.0 / (1.0 + (error[i] / scale) ** 2)
            for m in range(4):
                row[m] = -side[i, m]
            row[4] = -1.0
            for m in range(5):
                g[m] -= weight * row[m] * error[i]
                for l in range(m + 1):
                    A[m, l] += weight * row[m] * row[l]
        A[4, 4] += _PRIOR * count
        g[4] += _PRIOR * count * (start - radius)
        trace = A[0, 0] + A[1, 1] + A[2, 2] + A[3, 3] + A[4, 4]
        for m in range(5):
            A[m, m] += 1e-9 * trace
            for l in range(m):
                A[l, m] = A[m, l]
        if not cholesky(A, L):
            break
        solve_lower(L, g, 5)
        solve_upper(L, g, 5)
        a, b = min(max(g[0], -0.02), 0.02), min(max(g[1], -0.02), 0.02)
        turn_t, turn_v = min(max(g[2], -0.3), 0.3), min(max(g[3], -0.3), 0.3)
        norm = 0.0
        for m in range(3):
            c[m] += a * t[m] + b * v[m]
            u[m] += turn_t * t[m] + turn_v * v[m]
            norm += u[m] * u[m]
        u /= np.sqrt(norm)
        radius = min(max(radius + g[4], _LEAST), _MOST)
        if abs(a) + abs(b) + abs(g[4]) + 0.05 * (abs(turn_t) + abs(turn_v)) < 1e-4:
            break
    first, last = np.inf, -np.inf
    for i in range(count):
        if abs(error[i]) < 3.0 * max(_SCALE, 1.2 * before):
            along = (point[i, 0] - c[0]) * u[0] + (point[i, 1] - c[1]) * u[1] + (point[i, 2] - c[2]) * u[2]
            first, last = min(first, along), max(last, along)
    return c, u, radius, first, last


@njit(cache=True)
def _nearest(kind, size, link, R_CS, p_CS, p, local, surface, normal, out):
    """Return link and distance (m) of the moving shape nearest to p (3,); fill `out` (3,) with its surface point."""
    best, on = np.inf, -1
    for s in range(kind.shape[0]):
        if link[s] < 0:
            continue
        a, b, c = p[0] - p_CS[s, 0], p[1] - p_CS[s, 1], p[2] - p_CS[s, 2]
        R = R_CS[s]
        for k in range(3):
            local[k] = R[0, k] * a + R[1, k] * b + R[2, k] * c
        d = surface_point_local(kind[s], size[s], local, surface, normal)
        if d < best:
            best, on = d, link[s]
            for k in range(3):
                out[k] = p_CS[s, k] + R[k, 0] * surface[0] + R[k, 1] * surface[1] + R[k, 2] * surface[2]
    return on, best


@njit(cache=True)
def limb_contact(kind, size, link, R_CS, p_CS, c, u, radius, first, last, softness):
    """Return link, surface point (3,) in C and distance (m) from the axis, where a limb comes nearest to the robot.

    Along the side it is the mean of the surface points under the axis with weights max(`softness` − d + d_least, 0):
    the soft limb presses there. At the end of what is seen, a ball of the limb's radius goes on along the axis until it
    touches, or comes no nearer.
    """
    local, surface, normal, p = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    d, on, under = np.empty(_SAMPLES), np.empty(_SAMPLES, np.int64), np.empty((_SAMPLES, 3))
    step = (last - first) / (_SAMPLES - 1)
    best = 0
    for i in range(_SAMPLES):
        for k in range(3):
            p[k] = c[k] + (first + i * step) * u[k]
        on[i], d[i] = _nearest(kind, size, link, R_CS, p_CS, p, local, surface, normal, under[i])
        if d[i] < d[best]:
            best = i
    out = np.zeros(3)
    if 0 < best < _SAMPLES - 1:
        total = 0.0
        for i in range(_SAMPLES):
            weight = softness - d[i] + d[best]
            if weight > 0.0 and on[i] == on[best]:
                total += weight
                for k in range(3):
                    out[k] += weight * under[i, k]
        return on[best], out / total, d[best]
    outward = -1.0 if best == 0 else 1.0
    at = (first if best == 0 else last) - outward * radius
    far = at + outward * (radius + _BEYOND)
    trial = np.empty(3)
    found, gap = -1, np.inf
    for _ in range(40):
        for k in range(3):
            p[k] = c[k] + at * u[k]
        link_here, here = _nearest(kind, size, link, R_CS, p_CS, p, local, surface, normal, trial)
        if here >= gap:
            break
        found, gap = link_here, here
        out[:] = trial
        if gap - radius < 1e-4 or (far - at) * outward <= 0.0:
            break
        at += outward * min(max(gap - radius, 5e-4), (far - at) * outward)
    return found, out, gap
