"""How far each reading of a depth image is from the robot: the compiled pass over all pixels near it.

All passes of the localizer work in the camera frame C (x right, y down, z forward). The region is the rectangle of the
image, first row and column included, last ones not, outside of which nothing is near the robot. Masks over it carry a
border of `BORDER` pixels, so that windows need no checks.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import BOX, CAPSULE

BORDER = 4  # pixels; also the reach of growth and more than half a support window


@njit(cache=True, fastmath={"contract", "nsz", "arcp", "reassoc"})
def _shape_row(kind, size, R, p, s, z, x, y, best, owner):
    """Lower `best` (m) to the distance of the points (x z, y z, z) to shape s, which then owns them."""
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
def distances(z, limit, x, y, kind, size, R_CS, p_CS, left, right, region, seed, grow, z_ref, least):
    """Measure the foreground of the region against the shapes whose inflated silhouette covers it.

    Returns
    -------
    best (rows, cols) float32
        Distance to the nearest of those shapes (m); +inf where no shape is near. Junk where not foreground.
    owner (rows, cols) int32
        That shape (−1: none).
    weak, strong : (rows + 2 BORDER, cols + 2 BORDER) uint8
        Foreground beyond the distances `grow` and `seed` (m), both times max((z / z_ref)², least).
    """
    r0, r1, c0, c1 = region
    rows, cols = r1 - r0, c1 - c0
    best = np.full((rows, cols), np.float32(np.inf), np.float32)
    owner = np.full((rows, cols), np.int32(-1), np.int32)
    weak = np.zeros((rows + 2 * BORDER, cols + 2 * BORDER), np.uint8)
    strong = np.zeros((rows + 2 * BORDER, cols + 2 * BORDER), np.uint8)
    line = np.empty(cols, np.float32)
    seed, grow = np.float32(seed), np.float32(grow)
    per_z, least, zero = np.float32(1.0 / z_ref), np.float32(least), np.float32(0.0)
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
        for s in range(kind.shape[0]):
            a, b = max(left[s, r], c0 + first), min(right[s, r], c0 + last)
            if a < b:
                _shape_row(kind[s], size[s], R_CS[s], p_CS[s], s, line[a - c0 : b - c0], x[a:b], y[r],
                           best[i, a - c0 : b - c0], owner[i, a - c0 : b - c0])  # fmt: skip
        weak_row = weak[i + BORDER, BORDER : BORDER + cols]
        strong_row = strong[i + BORDER, BORDER : BORDER + cols]
        best_row = best[i]
        for j in range(first, last):
            scale = line[j] * per_z
            scale = scale * scale
            scale = scale if scale > least else least
            ok = line[j] > zero
            weak_row[j] = ok & (best_row[j] > grow * scale)
            strong_row[j] = ok & (best_row[j] > seed * scale)
    return best, owner, weak, strong
