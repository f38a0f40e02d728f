"""A convex mesh as a few primitives that contain it: slices along its longest axis, each a capsule, cylinder or box."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER, surface_point
from saphari_drake.robots.mesh_primitives import surface_points

Array = NDArray[np.float64]
# m; pieces that lie farther from the mesh on average are cut again. Assumed.
NEAR = 0.003
MOST = 6
SAMPLES = 600


class Piece(NamedTuple):
    """A primitive in the frame of a mesh."""

    kind: int
    size: tuple[float, float, float]  # m, see `math.primitives`
    R: Array  # (3, 3)
    p: Array  # (3,) m


def convex_pieces(vertices: Array, faces: list[list[int]]) -> list[Piece]:
    """Return primitives that contain a convex mesh, as few as lie within `NEAR` of it on average, at most `MOST`.

    Parameters
    ----------
    vertices : (v, 3) array
        m.
    faces : list of lists of int
        Vertices of each polygon.
    """
    triangles = np.array([[face[0], a, b] for face in faces for a, b in itertools.pairwise(face[1:])])
    corners = vertices[triangles]
    surface, body = surface_points(corners, SAMPLES), _body_axes(corners)
    best: tuple[float, list[Piece]] = (np.inf, [])
    for count in range(1, MOST + 1):
        pieces, depth = [], 0.0
        for edge, inside in _slices(corners, surface, body[:, 0], count):
            options = [
                (_depth(piece.kind, np.array(piece.size), piece.R, piece.p, inside), piece)
                for piece in _candidates(np.vstack([edge, inside]), body)
            ]
            own, piece = min(options, key=lambda option: option[0])
            depth += own * len(inside)
            pieces.append(piece)
        depth /= len(surface)
        if depth < 0.8 * best[0]:
            best = depth, pieces
        if best[0] < NEAR:
            break
    return best[1]


def _body_axes(corners: Array) -> Array:
    """Principal axes of the surface of triangles (t, 3, 3)."""
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    local = corners - np.average(corners.mean(axis=1), axis=0, weights=area)
    total = local.sum(axis=1)
    moment = np.einsum("t,tia,tib->ab", area, local, local) + np.einsum("t,ta,tb->ab", area, total, total)
    return _axes(moment)


def _axes(moment: Array) -> Array:
    """Principal axes of a second moment (3, 3) as columns, the longest first, right-handed."""
    _, vectors = np.linalg.eigh(moment)
    R = vectors[:, ::-1]
    return R * np.array([1.0, 1.0, np.linalg.det(R)])


def _slices(corners: Array, surface: Array, along: Array, count: int) -> Iterator[tuple[Array, Array]]:
    """Yield, for each slice along an axis (3,), its extreme points and the samples of the surface inside it."""
    height, heights = corners @ along, surface @ along
    levels = np.linspace(height.min(), height.max(), count + 1)
    for low, high in itertools.pairwise(levels):
        edge = [corners[(height >= low - 1e-9) & (height <= high + 1e-9)]]
        for level in (low, high):
            for i in range(3):
                a, b, ha, hb = corners[:, i], corners[:, i - 1], height[:, i], height[:, i - 1]
                cut = (ha - level) * (hb - level) < 0.0
                share = ((level - ha[cut]) / (hb[cut] - ha[cut]))[:, None]
                edge.append(a[cut] + share * (b[cut] - a[cut]))
        inside = surface[(heights >= low) & (heights <= high)]
        if len(inside):
            yield np.concatenate(edge), inside


def _candidates(points: Array, body: Array) -> Iterator[Piece]:
    """Yield primitives that contain points: boxes, cylinders and capsules along axes of mesh, body and slice."""
    for R in (np.eye(3), body, _axes(np.cov(points.T))):
        for k in range(3):
            turned = np.ascontiguousarray(np.roll(R, 2 - k, axis=1))  # axis k comes last
            local = points @ turned
            low, high = local.min(axis=0), local.max(axis=0)
            half, middle = 0.5 * (high - low), 0.5 * (low + high)
            if k == 2:
                yield Piece(BOX, (half[0], half[1], half[2]), turned, turned @ middle)
            centre, radius = _circle(local[:, :2])
            p = turned @ np.array([*centre, middle[2]])
            yield Piece(CYLINDER, (radius, half[2], 0.0), turned, p)
            across = np.linalg.norm(local[:, :2] - centre, axis=1)
            straight = np.abs(local[:, 2] - middle[2]) - np.sqrt(np.maximum(radius**2 - across**2, 0.0))
            yield Piece(CAPSULE, (radius, max(straight.max(), 0.0), 0.0), turned, p)


@njit(cache=True)
def _circle(points):
    """Centre and radius of about the smallest circle around points (k, 2) (Badoiu and Clarkson, 2003)."""
    x, y = 0.5 * (points[:, 0].min() + points[:, 0].max()), 0.5 * (points[:, 1].min() + points[:, 1].max())
    radius = 0.0
    for k in range(1, 101):
        farthest, radius = 0, 0.0
        for i in range(points.shape[0]):
            away = np.hypot(points[i, 0] - x, points[i, 1] - y)
            if away > radius:
                farthest, radius = i, away
        if k < 100:
            x += (points[farthest, 0] - x) / (k + 1)
            y += (points[farthest, 1] - y) / (k + 1)
    return np.array([x, y]), radius


@njit(cache=True)
def _depth(kind, size, R, p, points):
    """Mean distance of points (k, 3) below the surface of a primitive (m)."""
    total = 0.0
    for i in range(points.shape[0]):
        total -= surface_point(kind, size, R, p, points[i])[0]
    return total / points.shape[0]
