"""A depth camera that casts the ray of each pixel itself: fast where shapes are primitives, and without a driver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    FrameId,
    GeometryId,
    HalfSpace,
    Mesh,
    QueryObject,
    Role,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import SensorError
from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER, Primitives, bounding_capsules
from saphari_drake.perception.camera.model import CameraParameters, back_projected, camera_pose, pinhole
from saphari_drake.perception.camera.open3d_import import import_open3d
from saphari_drake.perception.segmentation.regions import region_near
from saphari_drake.simulation.sensors.primitive_rays import ELLIPSOID, HALF_SPACE, draw, within

Depth = NDArray[np.float32]
Triangles = tuple[NDArray[np.float32], NDArray[np.uint32]]  # vertices (m, in the shape's frame), and rows of three


class RaycastingDepthCamera(LeafSystem):
    """Depth camera fixed in the world, of the geometry with the perception role that is registered by now.

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

    Rays meet primitives exactly, and only in the pixels around the bounding capsules of what moves; the triangles of
    meshes are Open3D's. A primitive is seen from outside: one that holds the camera is not seen.

    Parameters
    ----------
    inspector : SceneGraphInspector
        Of the SceneGraph that is connected.
    params : CameraParameters
    anchored : mapping from FrameId to RigidTransform
        Poses in the world of frames that never move, beside the world's own; what they carry is drawn once.

    Raises
    ------
    SensorError
        If a shape is neither a primitive nor a mesh that can be read, or Open3D cannot be imported for one that is.
    """

    def __init__(
        self,
        inspector: SceneGraphInspector,
        params: CameraParameters,
        anchored: Mapping[FrameId, RigidTransform] = MappingProxyType({}),
    ) -> None:
        super().__init__()
        self._near, self._far = np.float32(params.near), np.float32(params.far)
        self._X_CW = camera_pose(params).inverse()
        X_WF = {inspector.world_frame_id(): RigidTransform(), **anchored}
        self._moving: list[GeometryId] = []
        fixed: dict[GeometryId, RigidTransform] = {}
        for geometry in inspector.GetAllGeometryIds(Role.kPerception):
            frame = inspector.GetFrameId(geometry)
            if frame in X_WF:
                fixed[geometry] = X_WF[frame] @ inspector.GetPoseInFrame(geometry)
            else:
                self._moving.append(geometry)
        self._shapes = _Shapes(inspector, self._moving, params)
        self._background = np.full((params.height, params.width), np.inf, dtype=np.float32)
        _Shapes(inspector, list(fixed), params).draw(self._background, self._in_camera(list(fixed.values())))
        within(self._background.copy(), self._near, self._far)  # compiles
        self._query = self.DeclareAbstractInputPort("geometry_query", Value[QueryObject]())
        self.DeclareAbstractOutputPort(
            "depth_image_32f",
            alloc=lambda: AbstractValue.Make(ImageDepth32F(params.width, params.height)),
            calc=self._calc_image,
            prerequisites_of_calc={self._query.ticket()},
        )
        self.DeclareVectorOutputPort(
            "image_time", BasicVector(1), self._calc_time, prerequisites_of_calc={self.time_ticket()}
        )

    def _in_camera(self, poses: Sequence[RigidTransform]) -> list[RigidTransform]:
        return [self._X_CW @ X_WG for X_WG in poses]

    def _calc_image(self, context: Context, output: AbstractValue) -> None:
        query, depth = self._query.Eval(context), self._background.copy()
        self._shapes.draw(depth, self._in_camera([query.GetPoseInWorld(geometry) for geometry in self._moving]))
        within(depth, self._near, self._far)
        output.get_mutable_value().mutable_data[..., 0] = depth

    def _calc_time(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_time())


class _Shapes:
    """Shapes that are drawn together, the primitives among them and the meshes."""

    def __init__(self, inspector: SceneGraphInspector, geometries: Sequence[GeometryId], params: CameraParameters):
        shapes = [inspector.GetShape(geometry) for geometry in geometries]
        known = [(i, *row) for i, row in enumerate(map(primitive, shapes)) if row is not None]
        self._primitive = [i for i, *_ in known]
        self._kind = np.array([kind for _, kind, _ in known], dtype=np.int64)
        self._size = np.array([size for *_, size in known]).reshape(-1, 3)
        self._bounds = bounding_capsules(np.where(self._kind == ELLIPSOID, BOX, self._kind), self._size)
        self._pinhole = pinhole(params)
        self._meshes = {
            i: _triangles(shapes[i], inspector.GetName(geometry))
            for i, geometry in enumerate(geometries)
            if i not in self._primitive
        }
        self._rays = np.zeros((params.height, params.width, 6), dtype=np.float32)
        # Of length 1 along the optical axis, so that the hit parameter is the depth.
        self._rays[..., 3:] = back_projected(self._pinhole.x, self._pinhole.y, np.ones(self._rays.shape[:2]))

    def draw(self, depth: Depth, X_CS: Sequence[RigidTransform]) -> None:
        """Lower a depth image to the shapes at their poses in the camera frame, wherever they are nearer."""
        R = np.array([X_CS[i].rotation().matrix() for i in self._primitive]).reshape(-1, 3, 3)
        p = np.array([X_CS[i].translation() for i in self._primitive]).reshape(-1, 3)
        primitives = Primitives(self._kind, self._size, np.zeros_like(self._kind), R, p)
        region = region_near(primitives, self._bounds, 0.0, self._pinhole)
        everywhere = self._kind == HALF_SPACE
        region.left[everywhere], region.right[everywhere] = 0, depth.shape[1]
        draw(depth, self._kind, self._size, R, p, region.left, region.right, self._pinhole.x, self._pinhole.y)
        if self._meshes:
            np.minimum(depth, self._cast(X_CS), out=depth)

    def _cast(self, X_CS: Sequence[RigidTransform]) -> Depth:
        """Return the depth of the nearest triangle in each pixel, +inf without one."""
        o3d = import_open3d()
        tensor, scene = o3d.core.Tensor.from_numpy, o3d.t.geometry.RaycastingScene()
        for i, (vertices, triangles) in self._meshes.items():
            moved = X_CS[i].multiply(vertices.T.astype(float)).T
            scene.add_triangles(tensor(np.ascontiguousarray(moved, dtype=np.float32)), tensor(triangles))
        return scene.cast_rays(tensor(self._rays))["t_hit"].numpy()


def meshes(inspector: SceneGraphInspector) -> bool:
    """Whether a shape with the perception role is no primitive."""
    seen = inspector.GetAllGeometryIds(Role.kPerception)
    return any(primitive(inspector.GetShape(geometry)) is None for geometry in seen)


def primitive(shape: Shape) -> tuple[int, tuple[float, float, float]] | None:
    """Return kind and size of a shape as `draw` takes them, None for a mesh."""
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


def _triangles(shape: Shape, name: str) -> Triangles:
    if isinstance(shape, Convex) or (isinstance(shape, Mesh) and not shape.source().is_path()):
        return _hull(shape)
    if isinstance(shape, Mesh):
        mesh = import_open3d().io.read_triangle_mesh(str(shape.source().path()))
        if len(mesh.triangles) == 0:
            raise SensorError(f"geometry '{name}': no triangles can be read from {shape.source().path()}")
        return np.asarray(mesh.vertices * np.asarray(shape.scale3()), np.float32), np.asarray(mesh.triangles, np.uint32)
    raise SensorError(f"geometry '{name}': the ray-casting camera cannot show a {type(shape).__name__}")


def _hull(shape: Convex | Mesh) -> Triangles:
    """Triangles of the convex hull of a mesh that has no file, or is meant as convex."""
    hull = shape.GetConvexHull()
    vertices = np.array([hull.vertex(i) for i in range(hull.num_vertices())], dtype=np.float32)
    fans = []
    for i in range(hull.num_elements()):
        face = hull.element(i)
        corners = [face.vertex(j) for j in range(face.num_vertices())]
        fans += [[corners[0], corners[j], corners[j + 1]] for j in range(1, len(corners) - 1)]
    return vertices, np.array(fans, dtype=np.uint32)
