"""Meshes that Drake cannot use, STL and COLLADA, as OBJ files, which it can."""

from __future__ import annotations

import hashlib
import itertools
import os
import re
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.parsing import PackageMap

from saphari_drake.errors import ModelError

Array = NDArray[np.float64]
_MESHES = re.compile(r"""(filename\s*=\s*["']|<uri>\s*)([^"'<]+?)(\s*</uri>|["'])""")
_NS = "{http://www.collada.org/2005/11/COLLADASchema}"


def with_usable_meshes(path: Path, packages: PackageMap) -> str | None:
    """Return the text of a URDF or SDF in which meshes that Drake cannot use are OBJ files; None if there are none.

    Raises
    ------
    ModelError
        If such a mesh is missing, or cannot be read.
    """
    text = path.read_text(encoding="utf-8", errors="replace")

    def changed(match: re.Match[str]) -> str:
        file = _place(match[2], path, packages)
        if file is None or not file.is_file():
            return match[0]  # Drake tells it
        if file.suffix.lower() in (".stl", ".dae"):
            file = _as_obj(file, path)
        return f"{match[1]}file://{file.resolve()}{match[3]}"

    if path.suffix.lower() == ".xml" or not re.search(r"\.(stl|dae)\s*[\"'<]", text, re.IGNORECASE):
        return None
    return _MESHES.sub(changed, text)


def _place(address: str, path: Path, packages: PackageMap) -> Path | None:
    scheme, colon, rest = address.partition("://")
    if not colon:
        return path.parent / address
    if scheme == "file":
        return Path(rest)
    package, _, inside = rest.partition("/")
    return Path(packages.GetPath(package)) / inside if packages.Contains(package) else None


def _as_obj(mesh: Path, model: Path) -> Path:
    """Write a mesh as OBJ to the user's temporary folder, unless it is there; return its path."""
    stat = mesh.stat()
    name = hashlib.sha256(f"{mesh.resolve()} {stat.st_mtime_ns} {stat.st_size}".encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"saphari_drake-meshes-{os.getuid() if hasattr(os, 'getuid') else ''}"
    target = folder / f"{mesh.stem}-{name}.obj"
    if not target.is_file():
        try:
            triangles = read_stl(mesh) if mesh.suffix.lower() == ".stl" else read_collada(mesh)
        except (ValueError, KeyError, IndexError, ElementTree.ParseError) as error:
            raise ModelError(f"{model}: cannot read mesh '{mesh}': {error}") from error
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        temporary = target.with_suffix(f".{os.getpid()}")
        temporary.write_text(_obj(triangles))
        os.replace(temporary, target)
    return target


def read_stl(mesh: Path) -> Array:
    """Return the triangles (t, 3, 3) of an STL file, binary or text."""
    data = mesh.read_bytes()
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        rows = np.frombuffer(data, np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]), count, 84)
        return _finite(rows["v"].astype(float))
    numbers = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
    return _finite(np.array(numbers, dtype=float).reshape(-1, 3, 3))


def read_collada(mesh: Path) -> Array:
    """Return the triangles (t, 3, 3) of a COLLADA file in metres, its nodes put where its scene has them.

    As ROS does, its up-axis is not applied.
    """
    root = ElementTree.parse(mesh).getroot()
    unit = root.find(f"{_NS}asset/{_NS}unit")
    scale = 1.0 if unit is None else float(unit.get("meter", 1.0))
    geometries = {f"#{item.get('id')}": _geometry(item) for item in root.iter(f"{_NS}geometry")}
    found: list[Array] = []

    def walk(node: ElementTree.Element, X: Array) -> None:
        for child in node:
            values = np.array((child.text or "").split(), dtype=float) if len(child) == 0 else np.zeros(0)
            if child.tag == f"{_NS}matrix":
                X = X @ values.reshape(4, 4)
            elif child.tag == f"{_NS}translate":
                X = X @ np.block([[np.eye(3), values[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
            elif child.tag == f"{_NS}scale":
                X = X @ np.diag([*values, 1.0])
            elif child.tag == f"{_NS}rotate":
                X = X @ _rotation(values)
            elif child.tag == f"{_NS}instance_geometry":
                found.append(geometries[child.get("url", "")] @ X[:3, :3].T + X[:3, 3])
            elif child.tag == f"{_NS}node":
                walk(child, X)

    for scene in root.iter(f"{_NS}visual_scene"):
        walk(scene, np.eye(4))
    return _finite(scale * np.concatenate(found))


def _rotation(axis_degrees: Array) -> Array:
    x, y, z = axis_degrees[:3] / np.linalg.norm(axis_degrees[:3])
    angle, K = np.deg2rad(axis_degrees[3]), np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    result = np.eye(4)
    result[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return result


def _geometry(geometry: ElementTree.Element) -> Array:
    """Triangles (t, 3, 3) of one geometry; polygons are cut into fans."""
    mesh = geometry.find(f"{_NS}mesh")
    if mesh is None:
        return np.zeros((0, 3, 3))
    arrays = {
        f"#{source.get('id')}": np.array(source.findtext(f"{_NS}float_array", "").split(), dtype=float)
        for source in mesh.iter(f"{_NS}source")
    }
    vertices = next(mesh.iter(f"{_NS}vertices"))
    names = {item.get("semantic"): item.get("source", "") for item in vertices}
    points, triangles = arrays[names["POSITION"]].reshape(-1, 3), []
    for kind in ("triangles", "polylist"):
        for part in mesh.iter(f"{_NS}{kind}"):
            inputs = {item.get("semantic"): int(item.get("offset", 0)) for item in part.iter(f"{_NS}input")}
            index = np.array(part.findtext(f"{_NS}p", "").split(), dtype=int)
            index = index.reshape(-1, max(inputs.values()) + 1)[:, inputs["VERTEX"]]
            counts = [int(word) for word in part.findtext(f"{_NS}vcount", "").split()]
            ends = np.cumsum(counts) if counts else np.arange(3, len(index) + 1, 3)
            for start, end in zip(np.concatenate(([0], ends[:-1])), ends):
                corners = index[start:end]
                triangles += [points[[corners[0], a, b]] for a, b in itertools.pairwise(corners[1:])]
    return np.array(triangles).reshape(-1, 3, 3)


def _finite(triangles: Array) -> Array:
    if len(triangles) == 0 or not np.isfinite(triangles).all():
        raise ValueError("holds no triangles, or numbers that are not finite")
    return triangles


def _obj(triangles: Array) -> str:
    points, index = np.unique(triangles.reshape(-1, 3).round(7), axis=0, return_inverse=True)
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in points.tolist()]
    faces = index.reshape(-1, 3) + 1
    lines += [f"f {a} {b} {c}" for a, b, c in faces.tolist() if a != b and b != c and c != a]
    return "\n".join(lines) + "\n"
