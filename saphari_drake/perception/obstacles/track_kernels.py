"""Which points belong to which obstacle points, and what follows from it; compiled."""

import numpy as np

from saphari_drake.compiled import njit


@njit(cache=True)
def _away(a, i, b, j):
    """Return the distance of rows i and j of two arrays (·, 3)."""
    return np.sqrt((a[i, 0] - b[j, 0]) ** 2 + (a[i, 1] - b[j, 1]) ** 2 + (a[i, 2] - b[j, 2]) ** 2)


@njit(cache=True)
def nearest_center(points, centers, gate):
    """Index of the nearest center of each point, −1 if none lies within the gate."""
    owner = np.full(len(points), -1)
    for i in range(len(points)):
        least = np.inf
        for j in range(len(centers)):
            away = _away(points, i, centers, j)
            if away < least:
                least = away
                if away <= gate:
                    owner[i] = j
    return owner


@njit(cache=True)
def means(points, owner, count):
    """Return the mean (count, 3) of the points that each center owns; zero for one that owns none."""
    total, number = np.zeros((count, 3)), np.zeros(count)
    for i in range(len(points)):
        if owner[i] >= 0:
            total[owner[i]] += points[i]
            number[owner[i]] += 1.0
    return total / np.maximum(number, 1.0).reshape(-1, 1)


@njit(cache=True)
def apart(p, order, least):
    """Which of the points (m, 3) to keep, by `order`, so that none lie closer than `least`."""
    keep = np.zeros(len(p), dtype=np.bool_)
    for j in order:
        free = True
        for i in range(len(p)):
            free = free and not (keep[i] and _away(p, i, p, j) < least)
        keep[j] = free
    return keep


@njit(cache=True)
def reach(points, half, owner, p, cube, extent):
    """Let each `extent` (m,) of obstacle points p reach, with a cube more, to both ends of all that belongs to them."""
    for i in range(len(points)):
        j = owner[i]
        if j >= 0:
            near = far = 0.0
            for k in range(3):
                middle = points[i, k] - p[j, k]
                far += (middle + half[i, k]) ** 2
                near += (middle - half[i, k]) ** 2
            extent[j] = max(extent[j], np.sqrt(max(far, near)) + cube)
