"""Where a person touches a robot, from one depth image and the posture of the robot when it was taken."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import bounding_capsules, nearest_surface_point
from saphari_drake.perception.camera.model import CameraParameters, camera_pose, ray_tables
from saphari_drake.perception.contact import limb as limb_kernels
from saphari_drake.perception.contact import nearest as nearest_kernels
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.perception.segmentation import person as person_kernels
from saphari_drake.perception.segmentation.background import Depth, background_depth
from saphari_drake.perception.segmentation.distances import distances
from saphari_drake.perception.segmentation.regions import region_of, row_intervals, share_seen
from saphari_drake.robots.shapes import LinkShapes

__all__ = ["Array", "ContactVision", "Depth", "Localization", "LocalizerParameters", "background_depth"]

Array = NDArray[np.float64]

_LIMB_READINGS = 300  # about so many are fitted
# Mean and deviation of the width of a finger and of the end of a limb, over the radius of the limb that is fitted
# around them; from random hands with fingers of 8 to 18 mm and fists of 35 to 46 mm in radius.
_THIN_WIDTH, _LIMB_WIDTH = (0.15, 0.08), (0.47, 0.10)
_MOST = 5.0  # deviations that count
_MOST_GAP = 2.0  # deviations; a limb that is farther from touching does not touch
# Radii inside the limb's extent from which, and from which on surely, it touches along its side; the cost of no limb.
_SIDE, _SIDE_COST = (0.3, 1.0), 16.0


class Localization(NamedTuple):
    """What one image shows.

    Attributes
    ----------
    link : int
        Link that the person is nearest to (−1: nobody within `reach`).
    distance : float
        Distance there (m).
    p_LC, n_L : (3,) arrays
        Nearest surface point (m) and outward normal, in the link's frame.
    seen : float
        Share of the robot's visible axis points that have a reading.
    human_points : (k, 3) array
        The person's points in the world (m).
    width : float
        Deviation across the view (m) of the part of the person that is near the point.
    limb_gap : float
        How far from touching a limb is that was fitted to the readings and gave the point (m; ∞: none was).
    cost : float
        −2 log of how well what is seen near the point suits this explanation of it (≥ 0).
    """

    link: int
    distance: float
    p_LC: Array
    n_L: Array
    seen: float
    human_points: Array
    width: float = 0.0
    limb_gap: float = np.inf
    cost: float = 0.0

    @property
    def limb(self) -> bool:
        """Whether the point is that of a fitted limb, not that of something as thick as it is wide."""
        return self.limb_gap < np.inf


class _Limb(NamedTuple):
    link: int
    p_CT: Array  # (3,) m, where it touches
    n_C: Array  # (3,) outward normal there
    gap: float  # m
    cost: float
    thin_cost: float  # of the other explanation


def shape_costs(width: float, inside: float, gap: float) -> tuple[float, float]:
    """Return the costs (−2 log) of a limb and of something thin, by the shape of what is seen near a place.

    A fist or the end of a limb is about as wide as the limb where it touches; a finger in front of a fist is not, and
    the limb fitted to fist and forearm would touch beside it. Only a limb goes on to both sides of the place.

    Parameters
    ----------
    width : float
        Deviation across the view of what is near the place, over the limb's radius.
    inside : float
        How far the place lies inside the extent of what is seen of the limb, over its radius (< 0: beyond its end).
    gap : float
        How far the limb is from touching, in deviations.
    """
    side = float(np.clip((inside - _SIDE[0]) / (_SIDE[1] - _SIDE[0]), 0.0, 1.0))
    narrow = min(max(_LIMB_WIDTH[0] - width, 0.0) / _LIMB_WIDTH[1], _MOST)
    wide = min(max(width - _THIN_WIDTH[0], 0.0) / _THIN_WIDTH[1], _MOST)
    return gap**2 + (1.0 - side) * narrow**2, wide**2 + side * _SIDE_COST


class ContactVision:
    """The localizer's law with its constants: image tables, shapes, camera pose and background limit.

    Parameters
    ----------
    shapes : LinkShapes
        The robot's surface.
    camera : CameraParameters
    params : LocalizerParameters
    background : (height, width) float32 array, optional
        As `background_depth` gives it; default: nothing but the robot and the person is in view.
    X_WC : RigidTransform, optional
        Pose of the camera, such as a corrected one; default: that of its parameters.
    """

    def __init__(
        self,
        shapes: LinkShapes,
        camera: CameraParameters,
        params: LocalizerParameters,
        background: Depth | None = None,
        X_WC: RigidTransform | None = None,
    ) -> None:
        size = (camera.height, camera.width)
        if background is None:
            background = np.full(size, np.inf, dtype=np.float32)
        if background.shape != size:
            raise ParameterError("background", f"needs the image's shape {size}, got {background.shape}")
        if shapes.count > 127:
            raise ParameterError("robot", f"at most 127 collision shapes are supported, got {shapes.count}")
        self.shapes, self.params = shapes, params
        X_WC = camera_pose(camera) if X_WC is None else X_WC
        self._R_WC, self._p_WC = X_WC.rotation().matrix(), X_WC.translation()
        self.x, self.y = ray_tables(camera)
        self.pinhole = camera.focal_x, camera.focal_y, *camera.center
        self._bounds = bounding_capsules(shapes.kind, shapes.size)
        scale = np.maximum((background / params.scale_depth) ** 2, params.least_scale)
        limit = np.full(size, np.inf)
        np.subtract(background, params.background_margin * scale, out=limit, where=np.isfinite(background))
        self.limit = limit.astype(np.float32)

    @property
    def pose(self) -> tuple[Array, Array]:
        """Rotation R_WC and position p_WC (m) of the camera."""
        return self._R_WC, self._p_WC

    def localize(self, depth: Depth, R_WL: Array, p_WL: Array) -> Localization:
        """Find the person's nearest point on the robot, as what is seen explains it best.

        Parameters
        ----------
        depth : (height, width) float32 array
            Depth image (m); 0, NaN and +inf are no reading.
        R_WL, p_WL : (n, 3, 3) and (n, 3) arrays
            Poses of the links when the image was taken.
        """
        return min(self.localize_several(depth, R_WL, p_WL, 1), key=lambda explanation: explanation.cost)

    def localize_several(
        self, depth: Depth, R_WL: Array, p_WL: Array, count: int, apart: float = 0.12
    ) -> list[Localization]:
        """Find up to `count` places where the person is near the robot, nearest first; at least one entry.

        Each but the first is the nearest part of the person that lies at least `apart` (m) from the points before, all
        of them within the gate. A place has one explanation or two: something as thick as it is wide, such as a
        finger, and a limb of which the camera sees the near side. Each has the cost that its shape has; what is felt
        can tell them apart. All hold the same `seen` and `human_points`.
        """
        p, shapes = self.params, self.shapes
        R_WS, p_WS = shapes.in_world(R_WL, p_WL)
        R_WC, p_WC = self._R_WC, self._p_WC
        R_CS, p_CS = R_WC.T @ R_WS, (p_WS - p_WC) @ R_WC
        rows, cols = depth.shape
        radius, half, axis = self._bounds
        left, right = row_intervals(radius, half, axis, R_CS, p_CS, p.reach, *self.pinhole, rows, cols)
        region = region_of(left, right)
        best, owner, weak, strong = distances(
            depth, self.limit, self.x, self.y, shapes.kind, shapes.size, R_CS, p_CS, left, right, region,
            p.seed_distance, p.grow_distance, p.scale_depth, p.least_scale,
        )  # fmt: skip
        human, box = person_kernels.human_mask(
            depth, best, weak, strong, region, p.reach, p.support, p.support_step, p.scale_depth, p.least_scale,
            p.component,
        )  # fmt: skip
        seen = share_seen(depth, half, axis, R_CS, p_CS, *self.pinhole)
        points = person_kernels.human_points(
            depth, self.limit, self.x, self.y, best, human, region, p.reach, p.points_stride
        )
        points = points @ R_WC.T + p_WC
        readings = person_kernels.person_readings(depth, self.x, self.y, best, owner, human, region, box, p.reach)
        found: list[Localization] = []
        for _ in range(count):
            link, distance, p_C, extent = nearest_kernels.soft_minimum(
                *readings, shapes.kind, shapes.size, shapes.link, R_CS, p_CS, p.rank, p.softness, p.spread,
                int(p.rounds),
            )  # fmt: skip
            if link < 0:
                break
            link, p_CT, n_C, width = nearest_kernels.behind_the_view(
                shapes.kind, shapes.size, shapes.link, R_CS, p_CS, link, p_C, extent, p.thickness, p.least_thickness,
                p.most_thickness,
            )  # fmt: skip
            limb = self._limb(readings[0], p_C, width, R_CS, p_CS) if distance < p.limb_distance else None
            thin_cost = 0.0 if limb is None else limb.thin_cost
            explanations = [(link, distance, p_CT, n_C, np.inf, thin_cost)]
            if limb is not None:
                explanations.append((limb.link, max(limb.gap, 0.0), limb.p_CT, limb.n_C, abs(limb.gap), limb.cost))
            for on, away, p_C_on, n_C_on, gap, cost in explanations:
                R_LC = R_WL[on].T @ R_WC
                p_LC = R_LC @ p_C_on + R_WL[on].T @ (p_WC - p_WL[on])
                found.append(Localization(on, away, p_LC, R_LC @ n_C_on, seen, points, width, gap, cost))
            if distance > p.gate:
                break
            readings = nearest_kernels.away_from(*readings, p_C, apart)
        return found or [Localization(-1, np.inf, np.zeros(3), np.zeros(3), seen, points)]

    def _limb(self, readings: Array, p_C: Array, width: float, R_CS: Array, p_CS: Array) -> _Limb | None:
        """Return where a limb around p_C touches, if one suits the readings."""
        p, s = self.params, self.shapes
        cloud = limb_kernels.readings_around(readings, p_C, p.limb_reach, _LIMB_READINGS)
        if len(cloud) < p.component:
            return None
        c, u, radius, first, last = limb_kernels.fit_limb(cloud)
        if radius < p.limb_radius:
            return None
        link, p_CT, d = limb_kernels.limb_contact(
            s.kind, s.size, s.link, R_CS, p_CS, c, u, radius, first, last, p.limb_softness
        )
        gap = d - radius
        if abs(gap) > _MOST_GAP * p.limb_gap or np.sum((p_CT - p_C) ** 2) > p.limb_reach**2:
            return None
        along = (p_C - c) @ u
        cost, thin_cost = shape_costs(width / radius, min(along - first, last - along) / radius, gap / p.limb_gap)
        _, _, p_CT, n_C = nearest_surface_point(s.kind, s.size, R_CS, p_CS, s.link == link, p_CT)
        return _Limb(link, p_CT, n_C, gap, cost, thin_cost)

    def on_surface(self, link: int, p_L: Array) -> tuple[Array, Array]:
        """Return the surface point of a link nearest to p_L and the outward normal there, all in the link's frame."""
        s = self.shapes
        _, _, p_LC, n_L = nearest_surface_point(s.kind, s.size, s.R_LS, s.p_LS, s.link == link, p_L)
        return p_LC, n_L
