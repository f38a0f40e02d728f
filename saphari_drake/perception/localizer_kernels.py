"""The compiled passes of the contact localizer, from a depth image to a point on the robot's surface.

All passes work in the camera frame C (x right, y down, z forward). The region is the rectangle of the image, first row
and column included, last ones not, outside of which nothing is near the robot. Arrays over it carry a border of
`BORDER` pixels, so that windows need no checks.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from saphari_drake.math.geometry import BOX, CAPSULE, surface_point_local

BORDER = 4  # pixels; also the reach of growth and more than half a support window
SUPPORT = 2  # pixels; the support window is 5 × 5


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


@njit(cache=True)
def _window_sum(mask, reach):
    """Count the marked pixels within `reach` rows and columns of each pixel at least BORDER from the edge."""
    rows, cols = mask.shape
    n = cols - 2 * BORDER
    across = np.zeros((rows, n), np.uint8)
    total = np.zeros((rows, cols), np.uint8)
    for r in range(rows):
        out = across[r]
        for k in range(-reach, reach + 1):
            row = mask[r, BORDER + k : BORDER + k + n]
            for j in range(n):
                out[j] += row[j]
    for r in range(BORDER, rows - BORDER):
        out = total[r, BORDER : BORDER + n]
        for k in range(-reach, reach + 1):
            row = across[r + k]
            for j in range(n):
                out[j] += row[j]
    return total


@njit(cache=True)
def _root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def _drop_small(mask, least):
    """Clear the 8-connected components with fewer than `least` pixels."""
    rows, cols = mask.shape
    most = rows * (cols // 2 + 1)
    start, stop, row = np.empty(most, np.int32), np.empty(most, np.int32), np.empty(most, np.int32)
    parent = np.empty(most, np.int32)
    count, above, above_end = 0, 0, 0
    for r in range(rows):
        line, first, c = mask[r], count, 0
        while c < cols:
            if line[c] == 0:
                c += 1
                continue
            begin = c
            while c < cols and line[c] != 0:
                c += 1
            start[count], stop[count], row[count], parent[count] = begin, c, r, count
            k = above
            while k < above_end and start[k] <= c:
                if stop[k] >= begin:
                    parent[_root(parent, k)] = _root(parent, count)
                k += 1
            while above < above_end and stop[above] < begin:
                above += 1
            count += 1
        above, above_end = first, count
    size = np.zeros(count, np.int64)
    for k in range(count):
        size[_root(parent, k)] += stop[k] - start[k]
    for k in range(count):
        if size[_root(parent, k)] < least:
            mask[row[k], start[k] : stop[k]] = 0


@njit(cache=True)
def _box(mask):
    """Return first and last row and first and last column with a marked pixel; last < first without one."""
    rows, cols = mask.shape
    top, bottom, first, last = rows, -1, cols, -1
    for r in range(rows):
        line, marked = mask[r], False
        for c in range(cols):
            if line[c]:
                marked = True
                first = min(first, c)
                break
        if marked:
            top, bottom = min(top, r), r
            c = cols - 1
            while line[c] == 0:
                c -= 1
            last = max(last, c)
    return top, bottom, first, last


@njit(cache=True)
def human_mask(z, best, weak, strong, region, reach, support, step, z_ref, least, component):
    """Return the pixels of the person: near a strong one, supported by their neighbours, and in a large component.

    A pixel is supported by those in its window that are near a strong one too, at a depth that differs by less than
    `step` (m) times max((z / z_ref)², least). The mixed readings at the edge of an arm before the robot have no such
    neighbours. Beyond `reach` (m) from the robot no support is needed.
    """
    rows, cols = weak.shape
    human = np.zeros((rows, cols), np.uint8)
    top, bottom, first, last = _box(strong)
    # The person's pixels near the robot lie within BORDER of a strong one: nothing else is looked at.
    top, first = max(top - 2 * BORDER, 0), max(first - 2 * BORDER, 0)
    bottom, last = min(bottom + 2 * BORDER + 1, rows), min(last + 2 * BORDER + 1, cols)
    if bottom - top <= 2 * BORDER:
        return human
    near = _window_sum(strong[top:bottom, first:last], BORDER)
    height, width = near.shape
    for r in range(height):
        out, a = near[r], weak[top + r, first:last]
        for c in range(width):
            out[c] = a[c] & (out[c] > 0)
    found = human[top:bottom, first:last]
    r0, c0 = region[0] + top - BORDER, region[2] + first - BORDER
    for r in range(BORDER, height - BORDER):
        row, depths, line = near[r], z[r + r0], best[top + r - BORDER]
        for c in range(BORDER, width - BORDER):
            if not row[c]:
                continue
            if line[first + c - BORDER] > reach:
                found[r, c] = 1
                continue
            depth = depths[c + c0]
            tolerance = step * max((depth / z_ref) ** 2, least)
            count = 0
            for i in range(r - SUPPORT, r + SUPPORT + 1):
                for j in range(c - SUPPORT, c + SUPPORT + 1):
                    if near[i, j]:
                        count += abs(z[i + r0, j + c0] - depth) < tolerance
            found[r, c] = count >= support
    _drop_small(found, component)
    return human


@njit(cache=True)
def _project(kind, size, R, p, x, y, z, local, normal, out):
    """Fill `out` with the projection of (x z, y z, z) on a shape; `local` and `normal` are scratch."""
    a, b, c = x * z - p[0], y * z - p[1], z - p[2]
    for k in range(3):
        local[k] = R[0, k] * a + R[1, k] * b + R[2, k] * c
    surface_point_local(kind, size, local, out, normal)
    a, b, c = out[0], out[1], out[2]
    for k in range(3):
        out[k] = p[k] + R[k, 0] * a + R[k, 1] * b + R[k, 2] * c


@njit(cache=True)
def soft_minimum(z, x, y, kind, size, link, R_CS, p_CS, best, owner, human, region, rank, softness, spread, rounds):
    """Return link, distance (m), surface point (3,) in C of the person's nearest part, and its extent; link −1 without.

    The `rank`-th smallest distance d to the moving links is the distance of the person. Projections on the surface
    are averaged with weights exp(−(d − d_rank) / softness), at most 1, within `spread` (m) of a centre, first that of
    the pixel with d_rank, then `rounds` − 1 times the last mean. The link is the one with most weight, the extent the
    covariance (3, 3) of the projections in m², without weights.
    """
    r0, r1, c0, c1 = region
    rows, cols = r1 - r0, c1 - c0
    nearest = np.full(rank, np.inf)
    where = np.zeros((rank, 2), np.int64)
    for i in range(rows):
        marked, line = human[i + BORDER, BORDER : BORDER + cols], best[i]
        for j in range(cols):
            if marked[j] and line[j] < nearest[rank - 1] and link[owner[i, j]] >= 0:
                k = rank - 1
                while k > 0 and nearest[k - 1] > line[j]:
                    nearest[k] = nearest[k - 1]
                    where[k, 0], where[k, 1] = where[k - 1, 0], where[k - 1, 1]
                    k -= 1
                nearest[k] = line[j]
                where[k, 0], where[k, 1] = i, j
    least = nearest[rank - 1]
    if least == np.inf:
        return -1, np.inf, np.zeros(3), np.zeros((3, 3))
    local, normal, centre = np.empty(3), np.empty(3), np.empty(3)
    i, j = where[rank - 1]
    s = owner[i, j]
    _project(kind[s], size[s], R_CS[s], p_CS[s], x[c0 + j], y[r0 + i], z[r0 + i, c0 + j], local, normal, centre)
    far, total, count = least + 6.0 * softness, 0, 0
    for i in range(rows):
        marked, line = human[i + BORDER, BORDER : BORDER + cols], best[i]
        for j in range(cols):
            total += marked[j] > 0 and line[j] < far
    point, weight, on = np.empty((total, 3)), np.empty(total), np.empty(total, np.int64)
    for i in range(rows):
        marked, line = human[i + BORDER, BORDER : BORDER + cols], best[i]
        for j in range(cols):
            if marked[j] and line[j] < far and link[owner[i, j]] >= 0:
                s = owner[i, j]
                _project(kind[s], size[s], R_CS[s], p_CS[s], x[c0 + j], y[r0 + i], z[r0 + i, c0 + j],
                         local, normal, point[count])  # fmt: skip
                weight[count], on[count] = np.exp(-max(line[j] - least, 0.0) / softness), link[s]
                count += 1
    votes = np.zeros(link.shape[0])
    first, second = np.zeros(3), np.zeros((3, 3))
    for _ in range(rounds):
        mean, first[:], second[:], votes[:] = np.zeros(3), 0.0, 0.0, 0.0
        weights, members = 0.0, 0
        for k in range(count):
            a, b, c = point[k, 0] - centre[0], point[k, 1] - centre[1], point[k, 2] - centre[2]
            if a * a + b * b + c * c < spread * spread:
                weights += weight[k]
                members += 1
                votes[on[k]] += weight[k]
                for m in range(3):
                    mean[m] += weight[k] * point[k, m]
                    first[m] += point[k, m] - centre[m]
                    for l in range(3):
                        second[m, l] += (point[k, m] - centre[m]) * (point[k, l] - centre[l])
        centre = mean / weights
    return int(np.argmax(votes)), least, centre, second / members - np.outer(first / members, first / members)


@njit(cache=True)
def clear_near(z, x, y, human, region, p, distance):
    """Clear the person's pixels within `distance` (m) of the point p (3,) in C."""
    r0, r1, c0, c1 = region
    for i in range(r1 - r0):
        for j in range(c1 - c0):
            if human[i + BORDER, j + BORDER]:
                depth = z[r0 + i, c0 + j]
                a, b, c = x[c0 + j] * depth - p[0], y[r0 + i] * depth - p[1], depth - p[2]
                if a * a + b * b + c * c < distance * distance:
                    human[i + BORDER, j + BORDER] = 0


@njit(cache=True)
def human_points(z, limit, x, y, best, human, region, reach, stride):
    """Return the person's points (k, 3) in C (m), at every `stride`-th row and column of the whole image.

    Within `reach` (m) of the robot they are those of `human`; elsewhere, foreground with five or more of its eight
    neighbours within 5 cm in depth.
    """
    rows, cols = z.shape
    r0, r1, c0, c1 = region
    out = np.empty((((rows + stride - 1) // stride) * ((cols + stride - 1) // stride), 3))
    count = 0
    for r in range(0, rows, stride):
        for c in range(0, cols, stride):
            depth = z[r, c]
            if not 0.0 < depth < limit[r, c]:
                continue
            if r0 <= r < r1 and c0 <= c < c1 and best[r - r0, c - c0] <= reach:
                taken = human[r - r0 + BORDER, c - c0 + BORDER] > 0
            else:
                alike = -1
                for i in range(max(r - 1, 0), min(r + 2, rows)):
                    for j in range(max(c - 1, 0), min(c + 2, cols)):
                        alike += abs(z[i, j] - depth) < 0.05
                taken = alike >= 5
            if taken:
                out[count, 0], out[count, 1], out[count, 2] = x[c] * depth, y[r] * depth, depth
                count += 1
    return out[:count].copy()
