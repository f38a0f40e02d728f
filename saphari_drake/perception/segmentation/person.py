"""Which readings near the robot are the person's: the compiled passes over masks, see `distances`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.perception.segmentation.distances import BORDER

SUPPORT = 2  # pixels; the support window is 5 × 5


class Readings(NamedTuple):
    """The person's readings near the robot, in C."""

    point: NDArray[np.float64]  # (k, 3) m
    distance: NDArray[np.float64]  # (k,) m, from the robot
    owner: NDArray[np.int64]  # (k,) nearest shape


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
def human_mask(z, near_robot, region, tuning):
    """Return the person's pixels: those near a strong one, supported by their neighbours, and in a large component.

    A pixel is supported by those in its window that are near a strong one too, at a depth that differs by less than
    `support_step` (m) times max((z / scale_depth)², least_scale). The mixed readings at the edge of an arm before the
    robot have no such neighbours. Beyond `reach` (m) from the robot no support is needed.
    """
    best, _, weak, strong = near_robot
    step, z_ref, least = tuning.support_step, tuning.scale_depth, tuning.least_scale
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
    r0, c0 = region.r0 + top - BORDER, region.c0 + first - BORDER
    for r in range(BORDER, height - BORDER):
        row, depths, line = near[r], z[r + r0], best[top + r - BORDER]
        for c in range(BORDER, width - BORDER):
            if not row[c]:
                continue
            if line[first + c - BORDER] > tuning.reach:
                found[r, c] = 1
                continue
            depth = depths[c + c0]
            tolerance = step * max((depth / z_ref) ** 2, least)
            count = 0
            for i in range(r - SUPPORT, r + SUPPORT + 1):
                for j in range(c - SUPPORT, c + SUPPORT + 1):
                    if near[i, j]:
                        count += abs(z[i + r0, j + c0] - depth) < tolerance
            found[r, c] = count >= tuning.support
    _drop_small(found, tuning.component)
    return human


def person_readings(z, pinhole, near_robot, human, region, reach):
    """Return the `Readings` of the person's pixels, as `human_mask` gives them, within `reach` (m) of the robot."""
    near = (human[BORDER:-BORDER, BORDER:-BORDER] > 0) & (near_robot.best < reach)
    i, j = np.divmod(np.flatnonzero(near), max(near.shape[1], 1))
    row, column = i + region.r0, j + region.c0
    depth = z[row, column]
    point = np.column_stack([pinhole.x[column] * depth, pinhole.y[row] * depth, depth])
    return Readings(point.astype(float), near_robot.best[i, j].astype(float), near_robot.owner[i, j].astype(np.int64))


@njit(cache=True)
def human_points(z, limit, pinhole, best, human, region, tuning):
    """Return the person's points (k, 3) in C (m), at every `points_stride`-th row and column of the whole image.

    Within `reach` (m) of the robot they are those of `human`; elsewhere, foreground with five or more of its eight
    neighbours within 5 cm in depth.
    """
    rows, cols = z.shape
    r0, r1, c0, c1 = region.r0, region.r1, region.c0, region.c1
    reach, stride = tuning.reach, tuning.points_stride
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
                out[count, 0], out[count, 1], out[count, 2] = pinhole.x[c] * depth, pinhole.y[r] * depth, depth
                count += 1
    return out[:count].copy()
