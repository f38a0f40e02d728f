"""Cloth around an arm: depth that differs from the arm's own by wrinkles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Capsule
from pydrake.math import RigidTransform

from experiments.localization.hands import Part
from saphari_drake.perception.camera.model import CameraParameters, back_projected, camera_pose, ray_tables

Depth = NDArray[np.float32]

_OFF = 0.002  # m; what is nearer to the surface of an arm belongs to it


def wrinkled(
    image: Depth,
    camera: CameraParameters,
    X_WH: RigidTransform,
    parts: Sequence[Part],
    rng: np.random.Generator,
    sigma: float,
    length: float,
) -> Depth:
    """Return an exact image (m) with wrinkles on parts of a hand at X_WH.

    The wrinkles are a sum of waves with wave lengths about `length` (m), of deviation `sigma` (m), towards the camera
    and away from it.
    """
    X_WC = camera_pose(camera)
    on, p_C = np.zeros(image.shape, dtype=bool), back_projected(*ray_tables(camera), image)
    for shape, X, _ in parts:
        half = shape.length() / 2 if isinstance(shape, Capsule) else 0.0
        X_CP = X_WC.inverse() @ X_WH @ X
        middle, axis = X_CP.translation(), X_CP.rotation().matrix()[:, 2]
        rows, cols = _window(camera, middle, half + shape.radius())
        w = p_C[rows, cols] - middle
        w = w - np.clip(w @ axis, -half, half)[..., None] * axis
        on[rows, cols] |= np.abs(np.linalg.norm(w, axis=-1) - shape.radius()) < _OFF
    p = p_C[on]
    waves = rng.normal(size=(8, 3)) * 2.0 * np.pi / length
    phases = rng.uniform(0.0, 2.0 * np.pi, 8)
    result = image.copy()
    result[on] += (sigma * np.sqrt(2.0 / 8.0) * np.sin(p @ waves.T + phases).sum(axis=1)).astype(np.float32)
    return result


def _window(camera: CameraParameters, p_C: NDArray[np.float64], radius: float) -> tuple[slice, slice]:
    """Return the rows and columns of an image that may show a ball around p_C (3,)."""
    near = max(p_C[2] - radius, 0.1)
    (cx, cy), x, y = camera.center, *(radius * f / near for f in (camera.focal_x, camera.focal_y))
    column, row = camera.focal_x * p_C[0] / max(p_C[2], 0.1) + cx, camera.focal_y * p_C[1] / max(p_C[2], 0.1) + cy
    rows = slice(max(int(row - y), 0), max(int(row + y) + 1, 0))
    return rows, slice(max(int(column - x), 0), max(int(column + x) + 1, 0))
