"""How near a robot's surface is to people, and how fast it goes towards them; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import BOX, surface_point
from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class Surface(NamedTuple):
    """The primitives of the links that move, as `LinkShapes` has them."""

    kind: NDArray[np.int64]  # (s,)
    size: Array  # (s, 3) m
    link: NDArray[np.int64]  # (s,)
    R_LS: Array  # (s, 3, 3)
    p_LS: Array  # (s, 3) m


class Balls(NamedTuple):
    """People and things as balls."""

    p: Array  # (m, 3) m, centres in the world
    v: Array  # (m, 3) m/s
    radius: Array  # (m,) m


NOBODY = Balls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def surface_of(robot: RobotModel) -> Surface:
    """Return the surface of a robot's moving links."""
    shapes = robot.shapes
    moving = np.flatnonzero(shapes.link >= 0)
    return Surface(
        shapes.kind[moving], shapes.size[moving], shapes.link[moving], shapes.R_LS[moving], shapes.p_LS[moving]
    )


def balls_of(points: ObstaclePoints) -> Balls | None:
    """Return people as balls where they were seen; None if they are lost or cannot be used."""
    p, v, radius = (np.asarray(x, dtype=float) for x in (points.p_WO, points.v_WO, points.radius))
    count = len(p)
    if points.status == ObstacleStatus.LOST:
        return None
    if (p.shape, v.shape, radius.shape) != ((count, 3), (count, 3), (count,)):
        return None
    if not all(np.isfinite(x).all() for x in (p, v, radius)) or np.any(radius < 0.0):
        return None
    return Balls(p, v, radius)


@njit(cache=True)
def posed(surface, motion):
    """Return R (s, 3, 3) and p (s, 3) of the shapes in the world."""
    count = surface.link.shape[0]
    R, p = np.empty((count, 3, 3)), np.empty((count, 3))
    for s in range(count):
        k = surface.link[s]
        for i in range(3):
            p[s, i] = motion.p_WL[k, i]
            for j in range(3):
                p[s, i] += motion.R_WL[k, i, j] * surface.p_LS[s, j]
                R[s, i, j] = 0.0
                for l in range(3):
                    R[s, i, j] += motion.R_WL[k, i, l] * surface.R_LS[s, l, j]
    return R, p


@njit(cache=True)
def towards(motion, link, p_WN, u, row):
    """Fill `row` (n,) with uᵀJ of a point p_WN (m, world) of a link, along a direction u (world)."""
    row[:] = 0.0
    k = link
    while k >= 0:
        S = motion.S[k]
        x = S[3] + S[1] * p_WN[2] - S[2] * p_WN[1]
        y = S[4] + S[2] * p_WN[0] - S[0] * p_WN[2]
        z = S[5] + S[0] * p_WN[1] - S[1] * p_WN[0]
        row[k] = u[0] * x + u[1] * y + u[2] * z
        k = motion.parent[k]


@njit(cache=True)
def pair(surface, poses, s, ball):
    """Return the distance (m) of shape s from the centre of a ball (3,), the nearest point, and the direction there."""
    return surface_point(surface.kind[s], surface.size[s], poses[0][s], poses[1][s], ball)


@njit(cache=True)
def bounding_radius(surface, s):
    """Return the radius (m) of the ball around the middle of shape s that holds it."""
    size = surface.size[s]
    if surface.kind[s] == BOX:
        return np.sqrt(size[0] ** 2 + size[1] ** 2 + size[2] ** 2)
    return size[0] + size[1]


@njit(cache=True)
def nearest_possible(poses, s, around, people, o):
    """Return a lower bound (m) of the distance of shape s, in a ball of radius `around`, from a person's ball."""
    square = 0.0
    for i in range(3):
        square += (poses[1][s, i] - people.p[o, i]) ** 2
    return np.sqrt(square) - around - people.radius[o]


@njit(cache=True)
def fastest_end(surface, motion, v):
    """Return the speed (m/s) of the fastest end of a shape at joint velocities v (n,)."""
    R, p = posed(surface, motion)
    row, axis, end = np.empty(v.shape[0]), np.zeros(3), np.empty(3)
    fastest = 0.0
    for s in range(p.shape[0]):
        half = surface.size[s, 2] if surface.kind[s] == BOX else surface.size[s, 1]
        for side in (-1.0, 1.0):
            end[:] = p[s] + side * half * R[s, :, 2]
            square = 0.0
            for i in range(3):
                axis[:] = 0.0
                axis[i] = 1.0
                towards(motion, surface.link[s], end, axis, row)
                square += np.sum(row * v) ** 2
            fastest = max(fastest, np.sqrt(square))
    return fastest
