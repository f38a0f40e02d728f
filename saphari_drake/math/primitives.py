"""Distance and projection to the primitives that stand for a robot's surface: capsule, cylinder and box.

A primitive has a kind, three sizes and a pose: a capsule and a cylinder lie along z of the shape frame S with
``size = (radius, half length, –)``, a sphere is a capsule of half length zero, and a box has its half extents in
``size``. Distances are signed: negative inside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit

CAPSULE = 0
CYLINDER = 1
BOX = 2


class Primitives(NamedTuple):
    """Primitives of a robot's links, posed in one frame, for compiled passes."""

    kind: NDArray[np.int64]  # (s,) CAPSULE, CYLINDER or BOX
    size: NDArray[np.float64]  # (s, 3) m
    link: NDArray[np.int64]  # (s,) that carries each (−1: fixed in the world)
    R: NDArray[np.float64]  # (s, 3, 3)
    p: NDArray[np.float64]  # (s, 3) m


@njit(cache=True)
def surface_point_local(kind, size, p, surface, normal):
    """Fill `surface` and `normal` with the projection of p and its outward normal, all in S; return the distance."""
    if kind == CAPSULE:
        return _on_capsule(size, p, surface, normal)
    if kind == CYLINDER:
        return _on_cylinder(size, p, surface, normal)
    return _on_box(size, p, surface, normal)


@njit(cache=True)
def _on_capsule(size, p, surface, normal):
    radius, half = size[0], size[1]
    axial = min(max(p[2], -half), half)
    dz = p[2] - axial
    rho = np.sqrt(p[0] * p[0] + p[1] * p[1] + dz * dz)
    if rho > 1e-12:
        normal[0], normal[1], normal[2] = p[0] / rho, p[1] / rho, dz / rho
    else:
        normal[0], normal[1], normal[2] = 1.0, 0.0, 0.0
    for i in range(3):
        surface[i] = radius * normal[i]
    surface[2] += axial
    return rho - radius


@njit(cache=True)
def _on_cylinder(size, p, surface, normal):
    radius, half = size[0], size[1]
    rho = np.hypot(p[0], p[1])
    cx, cy = 1.0, 0.0
    if rho > 1e-12:
        cx, cy = p[0] / rho, p[1] / rho
    side = -1.0 if p[2] < 0.0 else 1.0
    a, b = rho - radius, abs(p[2]) - half
    if a <= 0.0 and b <= 0.0:
        if a > b:
            surface[0], surface[1], surface[2] = radius * cx, radius * cy, p[2]
            normal[0], normal[1], normal[2] = cx, cy, 0.0
            return a
        surface[0], surface[1], surface[2] = p[0], p[1], side * half
        normal[0], normal[1], normal[2] = 0.0, 0.0, side
        return b
    a, b = max(a, 0.0), max(b, 0.0)
    distance = np.hypot(a, b)
    normal[0], normal[1], normal[2] = a / distance * cx, a / distance * cy, side * b / distance
    for i in range(3):
        surface[i] = p[i] - distance * normal[i]
    return distance


@njit(cache=True)
def _on_box(size, p, surface, normal):
    distance = 0.0
    face, depth = 0, -np.inf
    for i in range(3):
        excess = abs(p[i]) - size[i]
        if excess > depth:
            face, depth = i, excess
        if excess > 0.0:
            distance += excess * excess
        surface[i] = min(max(p[i], -size[i]), size[i])
    if distance > 0.0:
        distance = np.sqrt(distance)
        for i in range(3):
            normal[i] = (p[i] - surface[i]) / distance
        return distance
    side = -1.0 if p[face] < 0.0 else 1.0
    for i in range(3):
        normal[i] = 0.0
    normal[face] = side
    surface[face] = side * size[face]
    return depth


@njit(cache=True)
def surface_point(kind: int, size, R_WS, p_WS, p_WP):
    """Return distance, projection and outward normal of one point to one primitive.

    Parameters
    ----------
    kind : int
        CAPSULE, CYLINDER or BOX.
    size : (3,) array
        Sizes (m).
    R_WS, p_WS : (3,3) and (3,) arrays
        Pose of the primitive in any frame W (m).
    p_WP : (3,) array
        The point in W (m).

    Returns
    -------
    distance : float
        Signed distance (m); the projection is exact inside and outside.
    p_WN : (3,) array
        Nearest point of the surface, in W (m).
    n_W : (3,) array
        Outward unit normal there, in W.
    """
    offset = p_WP - p_WS
    local, surface, normal = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        local[i] = R_WS[0, i] * offset[0] + R_WS[1, i] * offset[1] + R_WS[2, i] * offset[2]
    distance = surface_point_local(kind, size, local, surface, normal)
    p_WN, n_W = np.empty(3), np.empty(3)
    for i in range(3):
        n_W[i] = R_WS[i, 0] * normal[0] + R_WS[i, 1] * normal[1] + R_WS[i, 2] * normal[2]
        p_WN[i] = p_WS[i] + R_WS[i, 0] * surface[0] + R_WS[i, 1] * surface[1] + R_WS[i, 2] * surface[2]
    return distance, p_WN, n_W


@njit(cache=True)
def nearest_surface_point(kind, size, R_WS, p_WS, chosen, p_WP):
    """Return the nearest among the chosen primitives and what `surface_point` gives for it.

    Parameters
    ----------
    kind (s,), size (s,3), R_WS (s,3,3), p_WS (s,3) : arrays
        Primitives, posed in any frame W.
    chosen : (s,) bool array
        Which primitives count.
    p_WP : (3,) array
        The point in W (m).

    Returns
    -------
    shape (−1 if none is chosen), distance, p_WN (3,), n_W (3,)
    """
    best, shape = np.inf, -1
    p_best, n_best = np.zeros(3), np.zeros(3)
    for s in range(kind.shape[0]):
        if chosen[s]:
            distance, p_WN, n_W = surface_point(kind[s], size[s], R_WS[s], p_WS[s], p_WP)
            if distance < best:
                best, shape, p_best, n_best = distance, s, p_WN, n_W
    return shape, best, p_best, n_best


def bounding_capsules(
    kind: NDArray[np.int64], size: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return radius (s,), half length (s,) and axis index (s,) of capsules that contain the primitives."""
    radius, half = size[:, 0].copy(), size[:, 1].copy()
    axis = np.full(len(kind), 2, dtype=np.int64)
    for s in np.flatnonzero(np.asarray(kind) == BOX):
        axis[s] = int(np.argmax(size[s]))
        half[s] = size[s, axis[s]]
        radius[s] = np.linalg.norm(np.delete(size[s], axis[s]))
    return radius, half, axis
