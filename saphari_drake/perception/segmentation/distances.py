"""How far each reading of a depth image is from the robot: the compiled pass over all pixels near it.

All passes work in the camera frame C (x right, y down, z forward). Masks over a `Region` carry a border of `BORDER`
pixels, so that windows need no checks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import BOX, CAPSULE

BORDER = 4  # pixels; also the reach of growth and more than half a support window


class RobotDistance(NamedTuple):
    """How far the foreground of a region is from the robot, the foreground being what lies before the background."""

    best: NDArray[np.float32]  # (rows, cols) m, distance to the nearest shape; +inf: no foreground, or no shape near
    owner: NDArray[np.int32]  # (rows, cols) that shape (−1: none)
    weak: NDArray[np.uint8]  # (rows + 2 BORDER, cols + 2 BORDER) foreground beyond `grow_distance` …
    strong: NDArray[np.uint8]  # … and beyond `seed_distance`, both times max((z / scale_depth)², least_scale)


@njit(cache=True, fastmath={"contract", "nsz", "arcp", "reassoc"})
def _shape_row(shapes, s, z, x, y, best, owner):
    """Lower `best` (m) to the distance of the points (x z, y z, z) to shape s, which then owns them."""
    kind, size, R, p = shapes.kind[s], shapes.size[s], shapes.R[s], shapes.p[s]
    r, a, b, c = np.float32(size[0]), np.float32(size[0]), np.float32(size[1]), np.float32(size[2])
    px, py, pz = np.float32(p[0]), np.float32(p[1]), np.float32(p[2])
    R00, R10, R20 = np.float32(R[0, 0]), np.float32(R[1, 0]), np.float32(R[2, 0])
    R01, R11, R21 = np.float32(R[0, 1]), np.float32(R[1, 1]), np.float32(R[2, 1])
    R02, R12, R22 = np.float32(R[0, 2]), np.float32(R[1, 2]), np.float32(R[2, 2])
    zero, me = np.float32(0.0), np.int32(s)
    n = z.shape[0]
    if kind == CAPSULE:
        for i in range(n):
            wx, wy, wz = x[i] * z[i] - px, y * z[i] - py, z[i] - pz
            t = wx * R02 + wy * R12 + wz * R22
            t = b if t > b else (-b if t < -b else t)
            wx, wy, wz = wx - t * R02, wy - t * R12, wz - t * R22
            d = np.sqrt(wx * wx + wy * wy + wz * wz) - r
            owner[i] = me if d < best[i] else owner[i]
            best[i] = d if d < best[i] else best[i]
    elif kind == BOX:
        for i in range(n):
            wx, wy, wz = x[i] * z[i] - px, y * z[i] - py, z[i] - pz
            qx = abs(wx * R00 + wy * R10 + wz * R20) - a
            qy = abs(wx * R01 + wy * R11 + wz * R21) - b
            qz = abs(wx * R02 + wy * R12 + wz * R22) - c
            inside = qx if qx > qy else qy
            inside = inside if inside > qz else qz
            qx, qy, qz = (qx if qx > zero else zero), (qy if qy > zero else zero), (qz if qz > zero else zero)
            d = np.sqrt(qx * qx + qy * qy + qz * qz) + (inside if inside < zero else zero)
            owner[i] = me if d < best[i] else owner[i]
            best[i] = d if d < best[i] else best[i]
    else:
        for i in range(n):
            wx, wy, wz = x[i] * z[i] - px, y * z[i] - py, z[i] - pz
            qx, qy = wx * R00 + wy * R10 + wz * R20, wx * R01 + wy * R11 + wz * R21
            qz = abs(wx * R02 + wy * R12 + wz * R22) - b
            qr = np.sqrt(qx * qx + qy * qy) - r
            inside = qr if qr > qz else qz
            qr, qz = (qr if qr > zero else zero), (qz if qz > zero else zero)
            d = np.sqrt(qr * qr + qz * qz) + (inside if inside < zero else zero)
            owner[i] = me if d < best[i] else owner[i]
            best[i] = d if d < best[i] else best[i]


@njit(cache=True)
def distances(z, limit, pinhole, shapes, region, tuning):
    """Measure the foreground of a region against the shapes whose inflated silhouettes cover it: `RobotDistance`.

    Parameters
    ----------
    z, limit : (height, width) float32 arrays
        Depth image, and the depth from which on it shows the background (m).
    pinhole : Pinhole
    shapes : Primitives
        The robot in C.
    region : Region
    tuning : Tuning
    """
    r0, c0, c1 = region.r0, region.c0, region.c1
    rows, cols = region.r1 - r0, c1 - c0
    infinite, none = np.float32(np.inf), np.int32(-1)
    best = np.full((rows, cols), infinite, np.float32)
    owner = np.full((rows, cols), none, np.int32)
    weak = np.zeros((rows + 2 * BORDER, cols + 2 * BORDER), np.uint8)
    strong = np.zeros((rows + 2 * BORDER, cols + 2 * BORDER), np.uint8)
    line = np.empty(cols, np.float32)
    seed, grow = np.float32(tuning.seed_distance), np.float32(tuning.grow_distance)
    per_z, least, zero = np.float32(1.0 / tuning.scale_depth), np.float32(tuning.least_scale), np.float32(0.0)
    for i in range(rows):
        r = r0 + i
        z_row, limit_row = z[r, c0:c1], limit[r, c0:c1]
        for j in range(cols):
            ok = (z_row[j] > zero) & (z_row[j] < limit_row[j])
            line[j] = z_row[j] if ok else zero
        first, last = 0, cols
        while first < last and line[first] == zero:
            first += 1
        while first < last and line[last - 1] == zero:
            last -= 1
        if first == last:
            continue
        best_row, owner_row = best[i], owner[i]
        for s in range(shapes.kind.shape[0]):
            a, b = max(region.left[s, r], c0 + first), min(region.right[s, r], c0 + last)
            if a < b:
                near = slice(a - c0, b - c0)
                _shape_row(shapes, s, line[near], pinhole.x[a:b], pinhole.y[r], best_row[near], owner_row[near])
        weak_row = weak[i + BORDER, BORDER : BORDER + cols]
        strong_row = strong[i + BORDER, BORDER : BORDER + cols]
        for j in range(first, last):
            scale = line[j] * per_z
            scale = scale * scale
            scale = scale if scale > least else least
            ok = line[j] > zero
            weak_row[j] = ok & (best_row[j] > grow * scale)
            strong_row[j] = ok & (best_row[j] > seed * scale)
            best_row[j] = best_row[j] if ok else infinite
            owner_row[j] = owner_row[j] if ok else none
    return RobotDistance(best, owner, weak, strong)
