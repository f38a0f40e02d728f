"""Capsules that stand for a mesh: what Drake cannot collide with, or a localizer not follow, becomes a few of them."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ModelError
from saphari_drake.robots.mesh_files import read_collada, read_stl

Array = NDArray[np.float64]
SPLITS = 2  # a mesh becomes at most 2**SPLITS capsules
WORTH = 0.75  # a split must save a quarter of the volume
QUANTILE = 0.97  # share of the surface that lies inside; a thin rim does not make a capsule thick
SMALLEST = 0.004  # m, radius
SAMPLES = 3000


class FittedCapsule(NamedTuple):
    """A capsule in the frame of its mesh, along z of its own."""

    R: Array  # (3, 3)
    p: Array  # (3,) m, its middle
    radius: float  # m
    length: float  # m, without its caps; 0: a sphere


def read_triangles(path: Path) -> Array:
    """Return the triangles (k, 3, 3) of an .stl, .obj or .dae file.

    Raises
    ------
    ModelError
        If the file is of another kind, or holds no triangle.
    """
    if not path.is_file():
        raise ModelError(f"no mesh file '{path}'")
    readers = {".stl": read_stl, ".dae": read_collada, ".obj": _read_obj}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise ModelError(f"{path}: a mesh for collisions is read from .stl, .obj or .dae, not from '{path.suffix}'")
    try:
        triangles = reader(path)
    except (ValueError, KeyError, IndexError, ElementTree.ParseError) as error:
        raise ModelError(f"{path}: no mesh can be read from it: {error}") from error
    if len(triangles) == 0:
        raise ModelError(f"{path}: holds no triangles")
    return triangles


def _read_obj(path: Path) -> Array:
    vertices, faces = [], []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "f":
            corners = [int(word.split("/")[0]) for word in words]
            corners = [c - 1 if c > 0 else len(vertices) + c for c in corners]
            faces += [(corners[0], *pair) for pair in itertools.pairwise(corners[1:])]
    return np.array(vertices, dtype=float).reshape(-1, 3)[np.array(faces, dtype=int).reshape(-1, 3)]


def fit_capsules(triangles: Array) -> list[FittedCapsule]:
    """Return up to four capsules around the surface of triangles (k, 3, 3), m; the same for the same triangles."""
    return _fitted(surface_points(triangles, SAMPLES), SPLITS)


def surface_points(triangles: Array, count: int) -> Array:
    """Return points (count, 3) spread evenly over triangles (k, 3, 3); their corners if they have no area."""
    rng = np.random.default_rng(0)
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if area.sum() == 0.0:
        return triangles.reshape(-1, 3)
    k = rng.choice(len(triangles), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    return np.asarray(a[k] + u * (b - a)[k] + v * (c - a)[k])


def _fitted(points: Array, splits: int) -> list[FittedCapsule]:
    whole = [_capsule(points)]
    if splits == 0:
        return whole
    axis, middle = whole[0].R[:, 2], whole[0].p
    sides = (points - middle) @ axis > 0.0
    if min(sides.sum(), (~sides).sum()) < 50:
        return whole
    halves = [part for side in (sides, ~sides) for part in _fitted(points[side], splits - 1)]
    return halves if sum(map(_volume, halves)) < WORTH * _volume(whole[0]) else whole


def _capsule(points: Array) -> FittedCapsule:
    """The thinnest of the capsules along the three principal directions."""
    _, directions = np.linalg.eigh(np.cov(points.T) + 1e-12 * np.eye(3))
    return min((_along(points, directions[:, i]) for i in range(3)), key=_volume)


def _along(points: Array, axis: Array) -> FittedCapsule:
    x = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(axis, x), axis])
    local = points @ R
    low, high = np.quantile(local, [1.0 - QUANTILE, QUANTILE], axis=0)
    middle = 0.5 * (low + high)
    radius = max(float(np.quantile(np.hypot(*(local - middle)[:, :2].T), QUANTILE)), SMALLEST)
    return FittedCapsule(R, R @ middle, radius, max(float(high[2] - low[2]) - 2.0 * radius, 0.0))


def _volume(capsule: FittedCapsule) -> float:
    return float(np.pi * capsule.radius**2 * (capsule.length + 4.0 / 3.0 * capsule.radius))
