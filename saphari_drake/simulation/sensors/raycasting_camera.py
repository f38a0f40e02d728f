"""A depth camera that casts rays with Open3D, for machines where no OpenGL driver exists."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Mesh,
    QueryObject,
    Role,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import SensorError
from saphari_drake.perception.camera.model import back_projected
from saphari_drake.perception.camera.open3d_import import import_open3d

Vertices = NDArray[np.float32]
Triangles = NDArray[np.uint32]

_SEGMENTS = 72  # around a circle: a sphere of 0.1 m is off by 0.1 mm at most


class RaycastingDepthCamera(LeafSystem):
    """Depth camera fixed in the world that casts one ray a pixel against the geometry of a SceneGraph.

    .. pydrake_system::

        name: RaycastingDepthCamera
        input_ports:
        - geometry_query
        output_ports:
        - depth_image_32f
        - image_time

    Ports
    -----
    geometry_query : abstract `QueryObject`, from the SceneGraph's query port.
    depth_image_32f : abstract `ImageDepth32F` (m along the optical axis): 0 nearer than `near`, +inf beyond `far`.
    image_time : 1 (s), the time of the Context, at which the image is rendered.

    It sees geometry with the perception role that is registered when it is constructed. Shapes become triangles
    there, and what is fixed in the world is rendered there too; later only the other triangles are moved.

    Parameters
    ----------
    inspector : SceneGraphInspector
        Of the SceneGraph that is connected.
    X_WC : RigidTransform
        Pose of the camera, z forward, x right, y down.
    x, y : (width,) and (height,) float32 arrays
        x/z of each column's and y/z of each row's rays in the camera frame.
    near, far : float
        Range of depths that are measured (m).

    Raises
    ------
    SensorError
        If Open3D cannot be imported or a shape cannot be turned into triangles.
    """

    def __init__(
        self,
        inspector: SceneGraphInspector,
        X_WC: RigidTransform,
        x: NDArray[np.float32],
        y: NDArray[np.float32],
        near: float,
        far: float,
    ) -> None:
        super().__init__()
        self._o3d = import_open3d()
        self._near, self._far = near, far
        R_WC = X_WC.rotation().matrix()
        rays = np.empty((len(y), len(x), 6), dtype=np.float32)
        rays[..., :3] = X_WC.translation()
        rays[..., 3:] = back_projected(x, y, np.ones((len(y), len(x)))) @ R_WC.T
        self._rays = rays
        self._moving: list[tuple[object, Vertices, Triangles]] = []
        fixed: list[tuple[Vertices, Triangles]] = []
        for geometry in inspector.GetAllGeometryIds(Role.kPerception):
            vertices, triangles = _triangulate(inspector.GetShape(geometry), inspector.GetName(geometry))
            if inspector.GetFrameId(geometry) == inspector.world_frame_id():
                fixed.append((_moved(inspector.GetPoseInFrame(geometry), vertices), triangles))
            else:
                self._moving.append((geometry, vertices, triangles))
        self._background = self._cast(fixed)
        self._query = self.DeclareAbstractInputPort("geometry_query", Value[QueryObject]())
        self.DeclareAbstractOutputPort(
            "depth_image_32f",
            alloc=lambda: AbstractValue.Make(ImageDepth32F(len(x), len(y))),
            calc=self._calc_image,
            prerequisites_of_calc={self._query.ticket()},
        )
        self.DeclareVectorOutputPort(
            "image_time", BasicVector(1), self._calc_time, prerequisites_of_calc={self.time_ticket()}
        )

    def _cast(self, meshes: list[tuple[Vertices, Triangles]]) -> NDArray[np.float32]:
        """Depth of the nearest triangle in each pixel, +inf without one."""
        if not meshes:
            return np.full(self._rays.shape[:2], np.inf, dtype=np.float32)
        scene = self._o3d.t.geometry.RaycastingScene()
        offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
        vertices = np.concatenate([vertices for vertices, _ in meshes])
        triangles = np.concatenate([triangles + np.uint32(k) for (_, triangles), k in zip(meshes, offsets)])
        tensor = self._o3d.core.Tensor.from_numpy
        scene.add_triangles(tensor(vertices), tensor(triangles))
        # The rays have length 1 along the optical axis, so that the hit parameter is the depth.
        return scene.cast_rays(tensor(self._rays))["t_hit"].numpy().copy()

    def _calc_image(self, context: Context, output: AbstractValue) -> None:
        query = self._query.Eval(context)
        depth = self._cast([(_moved(query.GetPoseInWorld(g), v), t) for g, v, t in self._moving])
        depth = np.minimum(depth, self._background)
        depth[depth > self._far] = np.inf
        depth[depth < self._near] = 0.0
        output.get_mutable_value().mutable_data[..., 0] = depth

    def _calc_time(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_time())


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
