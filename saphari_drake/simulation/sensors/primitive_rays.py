"""Depths of spheres, ellipsoids, capsules, cylinders, boxes and half spaces along the rays of a camera; compiled."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER
from saphari_drake.math.products import apply

# Size of both: half extents along x, y, z; a half space fills z < 0 and has none.
ELLIPSOID, HALF_SPACE = 3, 4


@njit(cache=True)
def draw(depth, kind, size, R_CS, p_CS, left, right, x, y):
    """Lower `depth` to that of each shape wherever the shape is nearer.

    Parameters
    ----------
    depth : (rows, columns) float32 array
        z in the camera frame (m), +inf where nothing is seen yet.
    kind, size : (s,) int array, (s, 3) array
        Radius and half length along z of a capsule or cylinder, half extents of a box or ellipsoid (m).
    R_CS, p_CS : (s, 3, 3) and (s, 3) arrays
        Poses of the shapes in the camera frame.
    left, right : (s, rows) int arrays
        Columns to be looked at, the last one not included.
    x, y : (columns,) and (rows,) arrays
        The ray of a pixel is (x, y, 1).
    """
    for s in range(len(kind)):
        R = R_CS[s]
        o = -apply(R.T, p_CS[s])  # the optical centre, seen from the shape
        for r in range(depth.shape[0]):
            e0, e1, e2 = R[1, 0] * y[r] + R[2, 0], R[1, 1] * y[r] + R[2, 1], R[1, 2] * y[r] + R[2, 2]
            for c in range(left[s, r], right[s, r]):
                d = (R[0, 0] * x[c] + e0, R[0, 1] * x[c] + e1, R[0, 2] * x[c] + e2)
                z = _entry(kind[s], size[s], o, d)
                if 0.0 < z < depth[r, c]:
                    depth[r, c] = z


@njit(cache=True)
def within(depth, near, far):
    """Set what is nearer than `near` (m) to 0, and what is beyond `far` to +inf."""
    for r in range(depth.shape[0]):
        row = depth[r]
        for c in range(len(row)):
            z = row[c]
            row[c] = np.inf if z > far else (0.0 if z < near else z)


@njit(cache=True)
def _entry(kind, size, o, d):
    """Return the least t at which o + t d enters a shape, +inf if it never does."""
    if kind == CAPSULE:
        return _capsule(size[0], size[1], o, d)
    if kind == CYLINDER:
        low, high = _round(o[0], o[1], d[0], d[1], size[0])
        first, last = _between(o[2], d[2], size[1])
        low, high = max(low, first), min(high, last)
        return low if low <= high else np.inf
    if kind == BOX:
        low, high = -np.inf, np.inf
        for i in range(3):
            first, last = _between(o[i], d[i], size[i])
            low, high = max(low, first), min(high, last)
        return low if low <= high else np.inf
    if kind == ELLIPSOID:
        a, b, c = size
        return _ball(o[0] / a, o[1] / b, o[2] / c, d[0] / a, d[1] / b, d[2] / c, 1.0)
    return -o[2] / d[2] if d[2] < 0.0 < o[2] else np.inf


@njit(cache=True)
def _ball(o0, o1, o2, d0, d1, d2, radius):
    a, b = d0 * d0 + d1 * d1 + d2 * d2, o0 * d0 + o1 * d1 + o2 * d2
    root = b * b - a * (o0 * o0 + o1 * o1 + o2 * o2 - radius * radius)
    return (-b - np.sqrt(root)) / a if root >= 0.0 else np.inf


@njit(cache=True)
def _round(o0, o1, d0, d1, radius):
    """Return where a ray enters and leaves an endless cylinder around z; (inf, −inf) if it passes."""
    a, b, c = d0 * d0 + d1 * d1, o0 * d0 + o1 * d1, o0 * o0 + o1 * o1 - radius * radius
    root = b * b - a * c
    if root < 0.0 or (a == 0.0 and c > 0.0):
        return np.inf, -np.inf
    if a == 0.0:
        return -np.inf, np.inf
    return (-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a


@njit(cache=True)
def _between(o, d, half):
    """Return where a ray enters and leaves the slab |coordinate| ≤ half."""
    if d == 0.0:
        return (-np.inf, np.inf) if abs(o) <= half else (np.inf, -np.inf)
    first, last = (-half - o) / d, (half - o) / d
    return min(first, last), max(first, last)


@njit(cache=True)
def _capsule(radius, half, o, d):
    if half > 0.0:
        t, _ = _round(o[0], o[1], d[0], d[1], radius)
        z = o[2] + t * d[2]
        if abs(z) <= half:
            return t
        if t == np.inf:
            return t
    one = _ball(o[0], o[1], o[2] - half, d[0], d[1], d[2], radius)
    return min(one, _ball(o[0], o[1], o[2] + half, d[0], d[1], d[2], radius)) if half > 0.0 else one
