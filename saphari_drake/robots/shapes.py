"""The robot's surface as a few primitives: what the camera, the localizer and the distance terms see of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Mesh, Role, SceneGraphInspector, Sphere
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER, nearest_surface_point


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
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    context,
    instance: ModelInstanceIndex,
    link_names: Sequence[str],
) -> LinkShapes:
    """Read the collision shapes of a model instance; a mesh becomes the box around its convex hull."""
    rows = []
    links = [plant.GetBodyByName(name, instance) for name in link_names]
    roots = [(-1, plant.world_body()), *enumerate(links)]
    own = set(plant.GetBodyIndices(instance))
    for link, root in roots:
        for body in plant.GetBodiesWeldedTo(root):
            if body.index() not in own:
                continue
            X_LB = body.body_frame().CalcPose(context, root.body_frame())
            for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(body.index()), Role.kProximity):
                X_LS = X_LB @ inspector.GetPoseInFrame(geometry)
                kind, size, p_SC = _primitive(inspector.GetShape(geometry))
                rows.append((link, kind, size, X_LS.rotation().matrix(), X_LS @ p_SC))
    return LinkShapes(
        link=np.array([row[0] for row in rows], dtype=np.int64),
        kind=np.array([row[1] for row in rows], dtype=np.int64),
        size=np.array([row[2] for row in rows], dtype=float).reshape(-1, 3),
        R_LS=np.array([row[3] for row in rows], dtype=float).reshape(-1, 3, 3),
        p_LS=np.array([row[4] for row in rows], dtype=float).reshape(-1, 3),
    )


def _primitive(shape) -> tuple[int, tuple[float, float, float], NDArray[np.float64]]:
    """Kind, size and centre (in the shape's own frame) of the primitive that stands for a shape."""
    centre = np.zeros(3)
    if isinstance(shape, Sphere):
        return CAPSULE, (shape.radius(), 0.0, 0.0), centre
    if isinstance(shape, Capsule):
        return CAPSULE, (shape.radius(), shape.length() / 2, 0.0), centre
    if isinstance(shape, Cylinder):
        return CYLINDER, (shape.radius(), shape.length() / 2, 0.0), centre
    if isinstance(shape, Box):
        return BOX, (shape.width() / 2, shape.depth() / 2, shape.height() / 2), centre
    if isinstance(shape, (Mesh, Convex)):
        hull = shape.GetConvexHull()
        corners = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        low, high = corners.min(axis=0), corners.max(axis=0)
        half = (high - low) / 2
        return BOX, (float(half[0]), float(half[1]), float(half[2])), (low + high) / 2
    raise TypeError(f"no primitive for a collision shape of type {type(shape).__name__}")
