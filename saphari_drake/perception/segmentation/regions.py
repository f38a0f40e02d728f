"""Where the robot's shapes lie in the image: the rows and columns worth examining, and whether they are seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit


class Region(NamedTuple):
    """Where rays pass near a robot: the columns of each shape and row, and the rectangle around all of them."""

    left: NDArray[np.int64]  # (s, rows) first column
    right: NDArray[np.int64]  # (s, rows) last one, not included
    r0: int  # first row and last one, not included; then the columns
    r1: int
    c0: int
    c1: int


@njit(cache=True)
def region_near(shapes, bounds, reach, pinhole):
    """Return the `Region` whose rays pass within `reach` (m) of shapes in C.

    Each shape's bounding capsule (`bounding_capsules`) is covered by spheres, and a sphere's silhouette in a row is
    exact.
    """
    radius, half, axis = bounds
    R_CS, p_CS = shapes.R, shapes.p
    fx, fy, cx, cy = pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy
    rows, cols = pinhole.y.shape[0], pinhole.x.shape[0]
    count = radius.shape[0]
    left = np.full((count, rows), cols, np.int64)
    right = np.zeros((count, rows), np.int64)
    for s in range(count):
        R = radius[s] + reach
        spheres = 1 + int(np.ceil(4.0 * half[s] / R))
        gap = 2.0 * half[s] / max(spheres - 1, 1)
        R2 = R * R + 0.25 * gap * gap
        u = R_CS[s, :, axis[s]]
        for k in range(spheres):
            t = -half[s] + k * gap
            x, y, z = p_CS[s, 0] + t * u[0], p_CS[s, 1] + t * u[1], p_CS[s, 2] + t * u[2]
            if z <= -np.sqrt(R2):
                continue
            A, K = y * y + z * z - R2, x * x + y * y + z * z - R2
            if A <= 0.0 or z * z <= R2:  # the camera is in the sphere, or nearly beside it
                left[s, :], right[s, :] = 0, cols
                continue
            rise = np.sqrt(R2 * A)
            top = int((y * z - rise) / (z * z - R2) * fy + cy - 1.5)
            bottom = int((y * z + rise) / (z * z - R2) * fy + cy + 1.5)
            for r in range(max(top, 0), min(bottom, rows)):
                v = (r + 0.5 - cy) / fy
                m = v * y + z
                D = K * (m * m - A * (v * v + 1.0))
                if D <= 0.0 or m <= 0.0:
                    continue
                root = np.sqrt(D)
                first = int(np.floor((x * m - root) / A * fx + cx - 0.5))
                last = int(np.ceil((x * m + root) / A * fx + cx - 0.5)) + 1
                left[s, r] = min(left[s, r], max(first, 0))
                right[s, r] = max(right[s, r], min(last, cols))
    r0, r1, c0, c1 = rows, 0, cols, 0
    for s in range(count):
        for r in range(rows):
            if left[s, r] < right[s, r]:
                r0, r1 = min(r0, r), max(r1, r + 1)
                c0, c1 = min(c0, left[s, r]), max(c1, right[s, r])
    return Region(left, right, r0, r1, c0, c1) if r0 < r1 else Region(left, right, 0, 0, 0, 0)


@njit(cache=True)
def share_seen(z, shapes, bounds, pinhole):
    """Return the share of the points on the shapes' axes, inside the image, at whose pixel anything is seen."""
    _, half, axis = bounds
    rows, cols = z.shape
    inside = seen = 0
    for s in range(half.shape[0]):
        for k in range(-3, 4):
            p = shapes.p[s] + (k / 3.0) * half[s] * shapes.R[s, :, axis[s]]
            if p[2] <= 0.0:
                continue
            c = int(np.floor(p[0] / p[2] * pinhole.fx + pinhole.cx))
            r = int(np.floor(p[1] / p[2] * pinhole.fy + pinhole.cy))
            if 0 <= r < rows and 0 <= c < cols:
                inside += 1
                seen += 0.0 < z[r, c] < np.inf
    return seen / inside if inside > 0 else 0.0
