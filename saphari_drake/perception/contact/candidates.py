"""Points spread evenly over the robot's surface: where a contact may be."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import BOX, CAPSULE, Primitives, surface_point
from saphari_drake.robots.model import RobotModel
from saphari_drake.robots.shapes import LinkShapes

Array = NDArray[np.float64]

_COVER = 0.002  # m; a point this deep inside another shape is covered by it


class SurfaceCandidates(NamedTuple):
    """Surface points as arrays.

    Attributes
    ----------
    link : (m,) int array
    p_L, n_L : (m, 3) arrays
        Point (m) and outward unit normal, in the link's frame.
    spacing : float
        Typical distance between neighbours (m).
    """

    link: NDArray[np.int64]
    p_L: Array
    n_L: Array
    spacing: float


def surface_candidates(robot: RobotModel, count: int = 1700, first_link: int = 1, seed: int = 0) -> SurfaceCandidates:
    """Spread about `count` points over the links from `first_link` on, leaving out what other shapes always cover.

    Parameters
    ----------
    robot : RobotModel
    count : int
        Number of points (≥ 10).
    first_link : int
        First link that counts. A force on the first link of an arm moves one joint only and is never localized.
    seed : int
        Seed of the surface samples that are thinned out.
    """
    if count < 10:
        raise ParameterError("count", f"must be at least 10, got {count}")
    rng = np.random.default_rng(seed)
    shapes = robot.shapes
    chosen = np.flatnonzero(shapes.link >= first_link)
    if len(chosen) == 0:
        raise ParameterError("first_link", f"no shape on link {first_link} or beyond")
    area = np.array([_area(shapes.kind[s], shapes.size[s]) for s in chosen])
    dense = [_samples(shapes, int(s), int(np.ceil(20 * count * a / area.sum())), rng) for s, a in zip(chosen, area)]
    link = np.concatenate([np.full(len(p), shapes.link[s]) for s, p in zip(chosen, dense)])
    own = np.concatenate([np.full(len(p), s) for s, p in zip(chosen, dense)])
    p_L = np.concatenate(dense)
    free = _ever_free(robot, own, link, p_L, rng)
    link, own, p_L = link[free], own[free], p_L[free]
    kept = np.concatenate(
        [np.flatnonzero(link == k)[_spread(p_L[link == k], round(count * np.mean(link == k)))] for k in np.unique(link)]
    )
    spacing = float(np.sqrt(area.sum() * np.mean(free) / len(kept)))
    smooth = rounded(shapes)
    n_L = np.array([smooth.nearest_on(int(link[i]), p_L[i])[1] for i in kept])
    return SurfaceCandidates(link[kept].astype(np.int64), p_L[kept], n_L, spacing)


def rounded(shapes: LinkShapes, rounding: float = 0.008) -> LinkShapes:
    """Return shapes with edges drawn in by `rounding` (m): their normals are those of shapes with rounded-off edges."""
    size = shapes.size.copy()
    sharp = shapes.kind != CAPSULE
    size[sharp] -= np.minimum(rounding, 0.5 * size[sharp])
    return replace(shapes, size=size)


def _area(kind: int, size: Array) -> float:
    if kind == BOX:
        return float(8.0 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0]))
    ends = 4.0 if kind == CAPSULE else 2.0
    return float(np.pi * (4.0 * size[0] * size[1] + ends * size[0] ** 2))


def _samples(shapes: LinkShapes, s: int, count: int, rng: np.random.Generator) -> Array:
    """Return random points (k, 3) on a shape, of equal density, in the link's frame."""
    kind, size = shapes.kind[s], shapes.size[s]
    if kind == BOX:
        faces = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
        axis = rng.choice(3, count, p=faces / faces.sum())
        p = rng.uniform(-1.0, 1.0, (count, 3)) * size
        p[np.arange(count), axis] = rng.choice([-1.0, 1.0], count) * size[axis]
    else:
        ends = 4.0 if kind == CAPSULE else 2.0
        on_side = rng.random(count) < 4.0 * size[1] / (4.0 * size[1] + ends * size[0])
        angle = rng.uniform(0.0, 2.0 * np.pi, count)
        ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
        up = np.array([0.0, 0.0, 1.0])
        side = np.where(rng.random(count) < 0.5, -1.0, 1.0)[:, None]
        if kind == CAPSULE:
            ball = rng.normal(size=(count, 3))
            ball /= np.linalg.norm(ball, axis=1, keepdims=True)
            end_p = size[0] * ball + np.where(ball[:, 2:] < 0.0, -1.0, 1.0) * size[1] * up
        else:
            end_p = size[0] * np.sqrt(rng.random((count, 1))) * ring + side * size[1] * up
        p = np.where(on_side[:, None], size[0] * ring + rng.uniform(-1.0, 1.0, (count, 1)) * size[1] * up, end_p)
    return p @ shapes.R_LS[s].T + shapes.p_LS[s]


def _ever_free(
    robot: RobotModel, own: NDArray[np.int64], link: NDArray[np.int64], p_L: Array, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Return which points lie outside all other shapes in at least one of some random postures."""
    shapes = robot.shapes
    low, high = np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi)
    free = np.zeros(len(p_L), dtype=bool)
    for k in range(12):
        q = robot.home if k == 0 else rng.uniform(low, high)
        at = robot.kinematics(q)
        R_WS, p_WS = shapes.in_world(at.R_WL, at.p_WL)
        p_W = at.p_WL[link] + np.einsum("mij,mj->mi", at.R_WL[link], p_L)
        _add_free(Primitives(shapes.kind, shapes.size, shapes.link, R_WS, p_WS), own, p_W, free)
    return free


@njit(cache=True)
def _add_free(shapes, own, p, free):
    """Mark the points p (m, 3) that lie outside all shapes but their own in one posture."""
    for i in range(own.shape[0]):
        covered = free[i]
        for s in range(shapes.kind.shape[0]):
            if covered:
                break
            if s != own[i]:
                covered = surface_point(shapes.kind[s], shapes.size[s], shapes.R[s], shapes.p[s], p[i])[0] <= -_COVER
        free[i] = free[i] or not covered


def _spread(points: Array, count: int) -> NDArray[np.int64]:
    """Return the indices of `count` points, each the farthest from those before it."""
    count = min(max(count, 1), len(points))
    chosen = np.zeros(count, dtype=np.int64)
    distance = np.full(len(points), np.inf)
    for k in range(1, count):
        distance = np.minimum(distance, np.sum((points - points[chosen[k - 1]]) ** 2, axis=1))
        chosen[k] = int(np.argmax(distance))
    return chosen
