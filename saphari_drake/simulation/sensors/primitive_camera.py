"""A depth camera that casts exact rays against primitive shapes: fast, and without a graphics driver."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    FrameId,
    GeometryId,
    HalfSpace,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform

from saphari_drake.errors import SensorError
from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER, Primitives, bounding_capsules
from saphari_drake.perception.camera.model import CameraParameters, camera_pose, pinhole
from saphari_drake.perception.segmentation.regions import region_near
from saphari_drake.simulation.sensors.depth_camera import DepthCamera
from saphari_drake.simulation.sensors.primitive_rays import ELLIPSOID, HALF_SPACE, draw

Array = NDArray[np.float64]
Kinds = NDArray[np.int64]


class PrimitiveDepthCamera(DepthCamera):
    """Depth camera that intersects the ray of each pixel with primitives; ports and parameters: `DepthCamera`.

    Shapes are seen from outside: one that holds the camera is not seen. A frame looks only at the pixels around the
    bounding capsules of what moves.

    Raises
    ------
    SensorError
        If a shape is no sphere, ellipsoid, capsule, cylinder, box or half space.
    """

    def __init__(
        self,
        inspector: SceneGraphInspector,
        params: CameraParameters,
        anchored: Mapping[FrameId, RigidTransform] = MappingProxyType({}),
    ) -> None:
        super().__init__(inspector, params, anchored)
        self._X_CW, self._pinhole = camera_pose(params).inverse(), pinhole(params)
        self._shapes = _primitives(inspector, self._moving)
        self._background = np.full((params.height, params.width), np.inf, dtype=np.float32)
        self._draw(self._background, *_primitives(inspector, list(self._fixed)), list(self._fixed.values()))

    def _depth(self, poses: list[RigidTransform]) -> NDArray[np.float32]:
        depth = self._background.copy()
        self._draw(depth, *self._shapes, poses)
        return depth

    def _draw(self, depth: NDArray[np.float32], kind: Kinds, size: Array, poses: list[RigidTransform]) -> None:
        X_CS = [self._X_CW @ X_WS for X_WS in poses]
        R = np.array([X.rotation().matrix() for X in X_CS]).reshape(-1, 3, 3)
        p = np.array([X.translation() for X in X_CS]).reshape(-1, 3)
        bounds = bounding_capsules(np.where(kind == ELLIPSOID, BOX, kind), size)
        region = region_near(Primitives(kind, size, np.zeros_like(kind), R, p), bounds, 0.0, self._pinhole)
        everywhere = kind == HALF_SPACE
        region.left[everywhere], region.right[everywhere] = 0, depth.shape[1]
        draw(depth, kind, size, R, p, region.left, region.right, self._pinhole.x, self._pinhole.y)


def meshes(inspector: SceneGraphInspector) -> list[str]:
    """Return the names of the shapes with the perception role that this camera cannot show."""
    seen = inspector.GetAllGeometryIds(Role.kPerception)
    return [inspector.GetName(g) for g in seen if _primitive(inspector.GetShape(g)) is None]


def _primitives(inspector: SceneGraphInspector, geometries: list[GeometryId]) -> tuple[Kinds, Array]:
    rows = [_primitive(inspector.GetShape(geometry)) for geometry in geometries]
    known = [row for row in rows if row is not None]
    if len(known) < len(rows):
        missing = ", ".join(f"'{name}'" for name in meshes(inspector))
        raise SensorError(f"geometry {missing}: no primitive; set the camera's renderer to 'vtk' or 'raycast'")
    return np.array([kind for kind, _ in known], dtype=np.int64), np.array([size for _, size in known]).reshape(-1, 3)


def _primitive(shape: Shape) -> tuple[int, tuple[float, float, float]] | None:
    """Return kind and size of a shape, None for a mesh."""
    if isinstance(shape, Sphere):
        return CAPSULE, (shape.radius(), 0.0, 0.0)
    if isinstance(shape, Capsule):
        return CAPSULE, (shape.radius(), shape.length() / 2, 0.0)
    if isinstance(shape, Cylinder):
        return CYLINDER, (shape.radius(), shape.length() / 2, 0.0)
    if isinstance(shape, Box):
        return BOX, (shape.width() / 2, shape.depth() / 2, shape.height() / 2)
    if isinstance(shape, Ellipsoid):
        return ELLIPSOID, (shape.a(), shape.b(), shape.c())
    if isinstance(shape, HalfSpace):
        return HALF_SPACE, (1.0, 0.0, 0.0)  # any size: it is looked for in all pixels
    return None
