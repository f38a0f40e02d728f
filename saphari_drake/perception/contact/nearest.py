"""The person's nearest place on the robot: a soft minimum over the person's readings, in the camera frame C."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import nearest_surface_point, surface_point
from saphari_drake.perception.segmentation.person import Readings


@njit(cache=True)
def soft_minimum(readings, shapes, rank, softness, spread, rounds):
    """Return link, distance (m), surface point (3,) in C of the person's nearest part, and its extent; link −1 without.

    The `rank`-th smallest distance d to the moving links is the distance of the person. Projections on the surface
    are averaged with weights exp(−(d − d_rank) / softness), at most 1, within `spread` (m) of a centre, first that of
    the reading with d_rank, then `rounds` − 1 times the last mean. The link is the one with most weight, the extent the
    covariance (3, 3) of the projections in m², without weights.

    Parameters
    ----------
    readings : Readings
        The person's.
    shapes : Primitives
        The robot's, in C.
    """
    point, distance, owner = readings
    link = shapes.link
    nearest, where = np.full(rank, np.inf), np.zeros(rank, np.int64)
    for i in range(distance.shape[0]):
        if distance[i] < nearest[rank - 1] and link[owner[i]] >= 0:
            k = rank - 1
            while k > 0 and nearest[k - 1] > distance[i]:
                nearest[k], where[k] = nearest[k - 1], where[k - 1]
                k -= 1
            nearest[k], where[k] = distance[i], i
    least = nearest[rank - 1]
    if least == np.inf:
        return -1, np.inf, np.zeros(3), np.zeros((3, 3))
    i = where[rank - 1]
    s = owner[i]
    _, centre, _ = surface_point(shapes.kind[s], shapes.size[s], shapes.R[s], shapes.p[s], point[i])
    near = np.flatnonzero((distance < least + 6.0 * softness) & (link[owner] >= 0))
    count = near.shape[0]
    on_surface = np.empty((count, 3))
    for k in range(count):
        s = owner[near[k]]
        _, on_surface[k], _ = surface_point(shapes.kind[s], shapes.size[s], shapes.R[s], shapes.p[s], point[near[k]])
    weight, on = np.exp(-np.maximum(distance[near] - least, 0.0) / softness), link[owner[near]]
    votes = np.zeros(link.shape[0])
    first, second = np.zeros(3), np.zeros((3, 3))
    members = 0
    for _ in range(rounds):
        mean, first[:], second[:], votes[:] = np.zeros(3), 0.0, 0.0, 0.0
        weights, members = 0.0, 0
        for k in range(count):
            a, b, c = on_surface[k, 0] - centre[0], on_surface[k, 1] - centre[1], on_surface[k, 2] - centre[2]
            if a * a + b * b + c * c < spread * spread:
                weights += weight[k]
                members += 1
                votes[on[k]] += weight[k]
                for m in range(3):
                    mean[m] += weight[k] * on_surface[k, m]
                    first[m] += on_surface[k, m] - centre[m]
                    for l in range(3):
                        second[m, l] += (on_surface[k, m] - centre[m]) * (on_surface[k, l] - centre[l])
        centre = mean / weights
    mean = first / members
    for m in range(3):
        for l in range(3):
            second[m, l] = second[m, l] / members - mean[m] * mean[l]
    return int(np.argmax(votes)), least, centre, second


@njit(cache=True)
def away_from(readings, p, apart):
    """Return the readings that lie at least `apart` (m) from the point p (3,)."""
    left = np.sum((readings.point - p) ** 2, axis=1) >= apart * apart
    return Readings(readings.point[left], readings.distance[left], readings.owner[left])


@njit(cache=True)
def behind_the_view(shapes, on, p, extent, share, least, most):
    """Move a surface point (3,) of link `on` behind what the camera sees of a thing that is as thick as it is wide.

    The camera sees the near side; the middle lies behind it along the surface by `share` of the width, at least `least`
    and at most `most` (m).

    Returns
    -------
    link, p (3,), n (3,) : the surface point of any moving link there (m), and its outward normal, in C
    width : deviation of the extent (3, 3) across the view (m)
    """
    kind, size, link, R_CS, p_CS = shapes
    _, _, surface, n = nearest_surface_point(kind, size, R_CS, p_CS, link == on, p)
    away = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    ray, across = p / away, np.empty(3)
    along = ray[0] * n[0] + ray[1] * n[1] + ray[2] * n[2]
    across[0] = n[1] * ray[2] - n[2] * ray[1]
    across[1] = n[2] * ray[0] - n[0] * ray[2]
    across[2] = n[0] * ray[1] - n[1] * ray[0]
    norm = max(np.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2), 1e-9)
    variance = 0.0
    for i in range(3):
        for j in range(3):
            variance += across[i] * extent[i, j] * across[j]
    width = np.sqrt(max(variance, 0.0)) / norm
    shift = min(max(share * width, least), most)
    s, _, q, m = nearest_surface_point(kind, size, R_CS, p_CS, link >= 0, surface + shift * (ray - along * n))
    return link[s], q, m, width
