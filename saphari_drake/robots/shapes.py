"""The robot's surface as a few primitives: what the camera, the localizer and the distance terms see of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Mesh, Role, SceneGraphInspector, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from saphari_drake.errors import ModelError
from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER, nearest_surface_point
from saphari_drake.robots.convex_pieces import Piece, convex_pieces


@dataclass(frozen=True)
class LinkShapes:
    """Primitives fixed in the links, as arrays.

    Attributes
    ----------
    link : (s,) int array
        Link that carries each shape (−1: fixed in the world).
    kind : (s,) int array
        Of `math.primitives`: CAPSULE (a sphere is one of length zero), CYLINDER or BOX.
    size : (s, 3) array
        Dimensions (m), see the kinds.
    R_LS, p_LS : (s, 3, 3) and (s, 3) arrays
        Pose of the shape in the link (or world) frame.
    """

    link: NDArray[np.int64]
    kind: NDArray[np.int64]
    size: NDArray[np.float64]
    R_LS: NDArray[np.float64]
    p_LS: NDArray[np.float64]

    @property
    def count(self) -> int:
        """Number of shapes."""
        return len(self.link)

    def in_world(
        self, R_WL: NDArray[np.float64], p_WL: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return R_WS (s,3,3) and p_WS (s,3) for link poses R_WL (n,3,3), p_WL (n,3)."""
        R_all = np.concatenate([R_WL, np.eye(3)[None]])  # index −1 picks the world
        p_all = np.concatenate([p_WL, np.zeros((1, 3))])
        R = R_all[self.link]
        return R @ self.R_LS, p_all[self.link] + np.einsum("sij,sj->si", R, self.p_LS)

    def nearest_on(self, link: int, p_L: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the surface point (3,) of a link nearest to p_L (m) and the outward normal, in the link's frame."""
        _, _, p_LC, n_L = nearest_surface_point(self.kind, self.size, self.R_LS, self.p_LS, self.link == link, p_L)
        return p_LC, n_L


def read_shapes(
    plant: MultibodyPlant, inspector: SceneGraphInspector, instance: ModelInstanceIndex, link_names: Sequence[str]
) -> LinkShapes:
    """Read the collision shapes of a robot, the only one in its plant, with all that is fixed to it."""
    rows, context = [], plant.CreateDefaultContext()
    links = [plant.GetBodyByName(name, instance) for name in link_names]
    roots = [(-1, plant.world_body()), *enumerate(links)]
    for link, root in roots:
        for body in plant.GetBodiesWeldedTo(root):
            if body.index() == plant.world_body().index():
                continue
            X_LB = body.body_frame().CalcPose(context, root.body_frame())
            for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body.index()), Role.kProximity):
                X_LS = X_LB @ inspector.GetPoseInFrame(geometry)
                for kind, size, R, p in _pieces(inspector.GetShape(geometry)):
                    rows.append((link, kind, size, X_LS.rotation().matrix() @ R, X_LS @ p))
    return LinkShapes(
        link=np.array([row[0] for row in rows], dtype=np.int64),
        kind=np.array([row[1] for row in rows], dtype=np.int64),
        size=np.array([row[2] for row in rows], dtype=float).reshape(-1, 3),
        R_LS=np.array([row[3] for row in rows], dtype=float).reshape(-1, 3, 3),
        p_LS=np.array([row[4] for row in rows], dtype=float).reshape(-1, 3),
    )


def _pieces(shape) -> list[Piece]:
    """Return the primitives that stand for a shape, in its own frame; a mesh is its convex hull, as to Drake."""
    if isinstance(shape, (Mesh, Convex)):
        hull = shape.GetConvexHull()
        vertices = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        return convex_pieces(vertices, [_corners(hull, i) for i in range(hull.num_faces())])
    if isinstance(shape, Sphere):
        kind, size = CAPSULE, (shape.radius(), 0.0, 0.0)
    elif isinstance(shape, Capsule):
        kind, size = CAPSULE, (shape.radius(), shape.length() / 2, 0.0)
    elif isinstance(shape, Cylinder):
        kind, size = CYLINDER, (shape.radius(), shape.length() / 2, 0.0)
    elif isinstance(shape, Box):
        kind, size = BOX, (shape.width() / 2, shape.depth() / 2, shape.height() / 2)
    else:
        raise ModelError(f"no primitive for a collision shape of type {type(shape).__name__}")
    return [Piece(kind, size, np.eye(3), np.zeros(3))]


def _corners(hull, face: int) -> list[int]:
    """Vertices of a face of a convex hull."""
    element = hull.element(face)
    return [element.vertex(i) for i in range(element.num_vertices())]
