"""Capsules that stand for a mesh: what Drake cannot collide with, or a localizer not follow, becomes a few of them."""

from __future__ import annotations

import itertools
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import AngleAxis

from saphari_drake.errors import ModelError

Array = NDArray[np.float64]
SPLITS = 2  # a mesh becomes at most 2**SPLITS capsules
WORTH = 0.75  # a split must save a quarter of the volume
QUANTILE = 0.97  # share of the surface that lies inside; a thin rim does not make a capsule thick
SMALLEST = 0.004  # m, radius
SAMPLES = 3000
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


class FittedCapsule(NamedTuple):
    """A capsule in the frame of its mesh, along z of its own."""

    R: Array  # (3, 3)
    p: Array  # (3,) m, its middle
    radius: float  # m
    length: float  # m, without its caps; 0: a sphere


def read_triangles(path: Path) -> Array:
    """Return the triangles (k, 3, 3) of an .stl, .obj or .dae file; of a .dae, in m, each is a point of the surface.

    Raises
    ------
    ModelError
        If the file is of another kind, or holds no triangle.
    """
    if not path.is_file():
        raise ModelError(f"no mesh file '{path}'")
    if path.suffix.lower() == ".stl":
        triangles = _read_stl(path.read_bytes())
    elif path.suffix.lower() == ".obj":
        triangles = _read_obj(path.read_text(encoding="utf-8", errors="replace"))
    elif path.suffix.lower() == ".dae":
        triangles = np.repeat(_read_dae(ElementTree.parse(path).getroot())[:, None], 3, axis=1)
    else:
        raise ModelError(f"{path}: a mesh for collisions is read from .stl, .obj or .dae, not from '{path.suffix}'")
    if len(triangles) == 0 or not np.isfinite(triangles).all():
        raise ModelError(f"{path}: holds no triangles")
    return triangles


def _read_stl(data: bytes) -> Array:
    count = int.from_bytes(data[80:84], "little")
    if len(data) >= 84 + 50 * count and (count > 0 or not data.startswith(b"solid")):
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
        return np.frombuffer(data, kind, count, 84)["corners"].astype(float)
    return np.array(_VERTEX.findall(data), dtype=float).reshape(-1, 3, 3)


def _read_obj(text: str) -> Array:
    vertices, faces = [], []
    for line in text.splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "f":
            corners = [int(word.split("/")[0]) for word in words]
            corners = [c - 1 if c > 0 else len(vertices) + c for c in corners]
            faces += [(corners[0], *pair) for pair in itertools.pairwise(corners[1:])]
    return np.array(vertices, dtype=float).reshape(-1, 3)[np.array(faces, dtype=int).reshape(-1, 3)]


def _read_dae(root: ElementTree.Element) -> Array:
    """Vertices (k, 3), m, of all geometries that a COLLADA scene shows, where its nodes put them."""
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    vertices = {}
    for geometry in root.iter("geometry"):
        inputs = [i for v in geometry.iter("vertices") for i in v.iter("input") if i.get("semantic") == "POSITION"]
        wanted = {i.get("source", "")[1:] for i in inputs}
        arrays = [source.find("float_array") for source in geometry.iter("source") if source.get("id") in wanted]
        texts = [array.text or "" for array in arrays if array is not None]
        numbers = [np.array(text.split(), dtype=float).reshape(-1, 3) for text in texts]
        vertices[f"#{geometry.get('id')}"] = np.concatenate([np.empty((0, 3)), *numbers])
    found: list[Array] = [np.empty((0, 3))]

    def visit(node: ElementTree.Element, T: Array) -> None:
        for child in node:
            T = T @ _dae_transform(child)
        for instance in node.findall("instance_geometry"):
            found.append(vertices.get(instance.get("url", ""), np.empty((0, 3))) @ T[:3, :3].T + T[:3, 3])
        for child in node.findall("node"):
            visit(child, T)

    for scene in root.iter("visual_scene"):
        for node in scene.findall("node"):
            visit(node, np.eye(4))
    unit, up = root.find("asset/unit"), root.findtext("asset/up_axis", "Y_UP").strip()
    p = np.concatenate(found) * (1.0 if unit is None else float(unit.get("meter", "1")))
    return np.column_stack([p[:, 0], -p[:, 2], p[:, 1]]) if up == "Y_UP" else p


def _dae_transform(element: ElementTree.Element) -> Array:
    T = np.eye(4)
    if element.tag in ("matrix", "translate", "scale", "rotate"):
        numbers = np.array((element.text or "").split(), dtype=float)
        if element.tag == "matrix":
            T = numbers.reshape(4, 4)
        elif element.tag == "translate":
            T[:3, 3] = numbers
        elif element.tag == "scale":
            T[:3, :3] = np.diag(numbers)
        elif np.linalg.norm(numbers[:3]) > 0.0:
            T[:3, :3] = AngleAxis(np.deg2rad(numbers[3]), numbers[:3] / np.linalg.norm(numbers[:3])).rotation()
    return T


def fit_capsules(triangles: Array) -> list[FittedCapsule]:
    """Return up to four capsules around the surface of triangles (k, 3, 3), m; the same for the same triangles."""
    return _fitted(_samples(triangles), SPLITS)


def _samples(triangles: Array) -> Array:
    """Points (SAMPLES, 3) spread evenly over the surface."""
    rng = np.random.default_rng(0)
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if area.sum() == 0.0:
        return triangles.reshape(-1, 3)
    k = rng.choice(len(triangles), SAMPLES, p=area / area.sum())
    u, v = rng.random((2, SAMPLES, 1))
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
