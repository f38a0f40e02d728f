"""A depth camera that casts rays with Open3D, for machines where no OpenGL driver exists."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    FrameId,
    HalfSpace,
    Mesh,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform

from saphari_drake.errors import SensorError
from saphari_drake.perception.camera.model import CameraParameters, back_projected, camera_pose, ray_tables
from saphari_drake.perception.camera.open3d_import import import_open3d
from saphari_drake.simulation.sensors.depth_camera import DepthCamera

Vertices = NDArray[np.float32]
Triangles = NDArray[np.uint32]

_SEGMENTS = 72  # around a circle: a sphere of 0.1 m is off by 0.1 mm at most


class RaycastingDepthCamera(DepthCamera):
    """Depth camera that casts the ray of each pixel against triangles; ports and parameters: `DepthCamera`.

    Shapes become triangles at construction.

    Raises
    ------
    SensorError
        If Open3D cannot be imported or a shape cannot be turned into triangles.
    """

    def __init__(
        self,
        inspector: SceneGraphInspector,
        params: CameraParameters,
        anchored: Mapping[FrameId, RigidTransform] = MappingProxyType({}),
    ) -> None:
        super().__init__(inspector, params, anchored)
        self._o3d = import_open3d()
        X_WC = camera_pose(params)
        rays = np.empty((params.height, params.width, 6), dtype=np.float32)
        rays[..., :3] = X_WC.translation()
        rays[..., 3:] = back_projected(*ray_tables(params), np.ones(rays.shape[:2])) @ X_WC.rotation().matrix().T
        self._rays = rays
        self._meshes, fixed = (
            [_triangulate(inspector.GetShape(g), inspector.GetName(g)) for g in part]
            for part in (self._moving, self._fixed)
        )
        self._background = self._cast(fixed, list(self._fixed.values()))

    def _cast(self, meshes: list[tuple[Vertices, Triangles]], poses: list[RigidTransform]) -> NDArray[np.float32]:
        """Return the depth of the nearest triangle in each pixel, +inf without one."""
        if not meshes:
            return np.full(self._rays.shape[:2], np.inf, dtype=np.float32)
        scene = self._o3d.t.geometry.RaycastingScene()
        offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
        vertices = np.concatenate([_moved(pose, vertices) for (vertices, _), pose in zip(meshes, poses)])
        triangles = np.concatenate([triangles + np.uint32(k) for (_, triangles), k in zip(meshes, offsets)])
        tensor = self._o3d.core.Tensor.from_numpy
        scene.add_triangles(tensor(vertices), tensor(triangles))
        # The rays have length 1 along the optical axis, so that the hit parameter is the depth.
        return scene.cast_rays(tensor(self._rays))["t_hit"].numpy().copy()

    def _depth(self, poses: list[RigidTransform]) -> NDArray[np.float32]:
        return np.minimum(self._cast(self._meshes, poses), self._background)


def _moved(X_WG: RigidTransform, vertices: Vertices) -> Vertices:
    moved = vertices @ X_WG.rotation().matrix().astype(np.float32).T
    return moved + X_WG.translation().astype(np.float32)


def _triangulate(shape, name: str) -> tuple[Vertices, Triangles]:
    """Vertices (m, in the shape's frame) and triangles of a shape."""
    if isinstance(shape, Sphere):
        return _revolved(*_arc(shape.radius(), 0.0))
    if isinstance(shape, Ellipsoid):
        vertices, triangles = _revolved(*_arc(1.0, 0.0))
        return vertices * np.array([shape.a(), shape.b(), shape.c()], dtype=np.float32), triangles
    if isinstance(shape, Capsule):
        return _revolved(*_arc(shape.radius(), shape.length() / 2))
    if isinstance(shape, Cylinder):
        radius, half = shape.radius(), shape.length() / 2
        return _revolved(np.array([0.0, radius, radius, 0.0]), np.array([-half, -half, half, half]))
    if isinstance(shape, Box):
        return _box(np.array([shape.width(), shape.depth(), shape.height()]) / 2)
    if isinstance(shape, HalfSpace):
        vertices, triangles = _box(np.array([50.0, 50.0, 0.5]))
        return vertices - np.array([0.0, 0.0, 0.5], dtype=np.float32), triangles
    if isinstance(shape, Convex) or (isinstance(shape, Mesh) and not shape.source().is_path()):
        return _hull(shape)
    if isinstance(shape, Mesh):
        mesh = import_open3d().io.read_triangle_mesh(str(shape.source().path()))
        if len(mesh.triangles) == 0:
            raise SensorError(f"geometry '{name}': no triangles can be read from {shape.source().path()}")
        return np.asarray(mesh.vertices * np.asarray(shape.scale3()), np.float32), np.asarray(mesh.triangles, np.uint32)
    raise SensorError(f"geometry '{name}': the ray-casting camera cannot show a {type(shape).__name__}")


def _arc(radius: float, half: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Profile (distance from z, height) of a capsule around z."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, _SEGMENTS // 2 + 2)
    angle = np.insert(angle, len(angle) // 2, 0.0) if half > 0.0 else angle
    height = radius * np.sin(angle)
    height += half * np.where(np.arange(len(angle)) < len(angle) / 2, -1.0, 1.0)
    return radius * np.cos(angle), height


def _revolved(rho: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[Vertices, Triangles]:
    """Revolve a profile around z."""
    k = len(rho)
    angle = np.arange(_SEGMENTS) * 2 * np.pi / _SEGMENTS
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(_SEGMENTS)], axis=-1)
    vertices = rho[:, None, None] * ring + z[:, None, None] * np.array([0.0, 0.0, 1.0])
    i, j = np.meshgrid(np.arange(k - 1), np.arange(_SEGMENTS), indexing="ij")
    a, b = i * _SEGMENTS + j, i * _SEGMENTS + (j + 1) % _SEGMENTS
    first = np.stack([a, b, b + _SEGMENTS], axis=-1)
    second = np.stack([a, b + _SEGMENTS, a + _SEGMENTS], axis=-1)
    triangles = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    return vertices.reshape(-1, 3).astype(np.float32), triangles.astype(np.uint32)


def _box(half: NDArray[np.float64]) -> tuple[Vertices, Triangles]:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [corner for a, b, c, d in faces for corner in ([a, b, c], [a, c, d])]
    return corners.astype(np.float32), np.array(triangles, dtype=np.uint32)


def _hull(shape: Convex | Mesh) -> tuple[Vertices, Triangles]:
    """Triangles of the convex hull of a mesh that has no file, or is meant as convex."""
    hull = shape.GetConvexHull()
    vertices = np.array([hull.vertex(i) for i in range(hull.num_vertices())], dtype=np.float32)
    fans = []
    for i in range(hull.num_elements()):
        face = hull.element(i)
        corners = [face.vertex(j) for j in range(face.num_vertices())]
        fans += [[corners[0], corners[j], corners[j + 1]] for j in range(1, len(corners) - 1)]
    return vertices, np.array(fans, dtype=np.uint32)
