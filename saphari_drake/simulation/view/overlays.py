"""Arrows and markers that a replay shows beside the plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import Cylinder, Meshcat, MeshcatAnimation, MeshcatCone, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.errors import ParameterError

Array = NDArray[np.float64]

ROOT = "/drake/overlays"


@dataclass(frozen=True)
class Arrow:
    """An arrow whose length follows a vector; it is hidden while that is zero or not finite.

    Attributes
    ----------
    name : str
    tail : (T, 3) or (3,) array
        Where it starts, in the world (m).
    vector : (T, 3) or (3,) array
        What it shows, in world axes.
    scale : float
        Length per unit of the vector (m).
    color : (r, g, b) or (r, g, b, a)
        From 0 to 1.
    visible : (T,) array, optional
        When to show it; default: always.
    radius : float
        Radius of the shaft (m).
    """

    name: str
    tail: ArrayLike
    vector: ArrayLike
    scale: float = 0.01
    color: Sequence[float] = (0.84, 0.37, 0.0)
    visible: ArrayLike | None = None
    radius: float = 0.008


@dataclass(frozen=True)
class Marker:
    """A ball at a point; it is hidden while that is not finite.

    Attributes
    ----------
    name : str
    position : (T, 3) or (3,) array
        Its centre in the world (m).
    radius : float
        In m.
    color : (r, g, b) or (r, g, b, a)
        From 0 to 1.
    visible : (T,) array, optional
        When to show it; default: always.
    """

    name: str
    position: ArrayLike
    radius: float = 0.015
    color: Sequence[float] = (0.0, 0.45, 0.7)
    visible: ArrayLike | None = None


def record_overlay(
    meshcat: Meshcat, animation: MeshcatAnimation, overlay: Arrow | Marker, stamps: Array, frame_times: Array
) -> None:
    """Record an overlay, given at the times `stamps`, at every frame; the arrow's and the ball's shape never change."""
    path, color = f"{ROOT}/{overlay.name}", Rgba(*overlay.color)
    points, vectors, shown = shown_at(overlay, stamps, frame_times)
    if isinstance(overlay, Marker):
        meshcat.SetObject(path, Sphere(overlay.radius), color)
    else:
        # The shaft is a cylinder of length 1 from the tail on, stretched; the head keeps its size at the tip.
        meshcat.SetObject(f"{path}/shaft/body", Cylinder(overlay.radius, 1.0), color)
        meshcat.SetTransform(f"{path}/shaft/body", RigidTransform([0.0, 0.0, 0.5]))
        head = MeshcatCone(4.0 * overlay.radius, 2.2 * overlay.radius, 2.2 * overlay.radius)
        meshcat.SetObject(f"{path}/head/body", head, color)
        flipped = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.0])
        meshcat.SetTransform(f"{path}/head/body", flipped)
    last: bool | None = None
    for frame, (point, vector, visible) in enumerate(zip(points, vectors, shown)):
        if bool(visible) != last:
            last = bool(visible)
            animation.SetProperty(frame, path, "visible", last)
        if not visible:
            continue
        length = float(np.linalg.norm(vector))
        rotation = RotationMatrix.MakeFromOneVector(vector / length, 2)
        animation.SetTransform(frame, path, RigidTransform(rotation, point))
        if isinstance(overlay, Arrow):
            shaft = max(length - 4.0 * overlay.radius, 1e-4)
            animation.SetProperty(frame, f"{path}/shaft", "scale", [1.0, 1.0, shaft])
            animation.SetTransform(frame, f"{path}/head", RigidTransform([0.0, 0.0, max(length, 4.0 * overlay.radius)]))


def shown_at(overlay: Arrow | Marker, stamps: Array, at: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return where an overlay is (m), its vector (m; a ball's is the z axis) and whether it is shown, at each time."""
    anchor = overlay.tail if isinstance(overlay, Arrow) else overlay.position
    points = rows_at(stamps, np.atleast_2d(np.asarray(anchor, dtype=float)), at, overlay.name)
    shown = np.ones(at.size, dtype=bool)
    if overlay.visible is not None:
        given = np.asarray(overlay.visible, dtype=float).reshape(-1, 1)
        shown = rows_at(stamps, given, at, f"{overlay.name}.visible", nearest=True)[:, 0] > 0.5
    shown &= np.all(np.isfinite(points), axis=1)
    if isinstance(overlay, Marker):
        return points, np.tile([0.0, 0.0, 1.0], (at.size, 1)), shown
    given = np.atleast_2d(np.asarray(overlay.vector, dtype=float))
    vectors = overlay.scale * rows_at(stamps, given, at, overlay.name)
    return points, vectors, shown & (np.nan_to_num(np.linalg.norm(vectors, axis=1)) > 1e-6)


def rows_at(stamps: Array, values: Array, at: Array, name: str, nearest: bool = False) -> Array:
    """Return `values` at the times `at`, interpolated or from the nearest sample; one row holds for all times."""
    if values.ndim == 2 and values.shape[0] == 1:
        return np.repeat(values, at.size, axis=0)
    if values.ndim != 2 or values.shape[0] != stamps.size:
        raise ParameterError(name, f"needs a row for each of {stamps.size} times, got shape {values.shape}")
    if nearest:
        return values[np.searchsorted(0.5 * (stamps[1:] + stamps[:-1]), at)]
    return np.column_stack([np.interp(at, stamps, column) for column in values.T])
