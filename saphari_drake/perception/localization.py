"""Where a person touches a robot, from one depth image and the posture of the robot when it was taken."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.errors import ParameterError
from saphari_drake.math.geometry import bounding_capsules, nearest_surface_point
from saphari_drake.perception import limb_kernels, nearest_kernels, person_kernels
from saphari_drake.perception.background import Depth, background_depth
from saphari_drake.perception.distance_kernels import distances
from saphari_drake.perception.image_regions import region_of, row_intervals, share_seen
from saphari_drake.perception.localizer_parameters import LocalizerParameters
from saphari_drake.perception.rgbd_camera import CameraParameters, camera_pose, ray_tables
from saphari_drake.robots.shapes import LinkShapes

__all__ = ["Array", "ContactVision", "Depth", "Localization", "LocalizerParameters", "background_depth"]

Array = NDArray[np.float64]

_LIMB_READINGS = 300  # about so many are fitted


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
    """

    link: int
    distance: float
    p_LC: Array
    n_L: Array
    seen: float
    human_points: Array
    width: float = 0.0
    limb_gap: float = np.inf


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
        """Find the person's nearest point on the robot.

        Parameters
        ----------
        depth : (height, width) float32 array
            Depth image (m); 0, NaN and +inf are no reading.
        R_WL, p_WL : (n, 3, 3) and (n, 3) arrays
            Poses of the links when the image was taken.
        """
        return self.localize_several(depth, R_WL, p_WL, 1)[0]

    def localize_several(
        self, depth: Depth, R_WL: Array, p_WL: Array, count: int, apart: float = 0.12
    ) -> list[Localization]:
        """Find up to `count` places where the person is near the robot, nearest first; at least one entry.

        Each but the first is the nearest part of the person that lies at least `apart` (m) from the points before, all
        of them within the gate.
        All hold the same `seen` and `human_points`.
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
            limb = self._limb(readings[0], p_C, R_CS, p_CS) if width > p.limb_width else None
            if limb is None or distance > p.limb_distance:
                gap = np.inf
            else:
                link, p_CT, n_C, gap = limb
                distance = max(gap, 0.0)
            R_LC = R_WL[link].T @ R_WC
            p_LC = R_LC @ p_CT + R_WL[link].T @ (p_WC - p_WL[link])
            found.append(Localization(link, distance, p_LC, R_LC @ n_C, seen, points, width, abs(gap)))
            if distance > p.gate:
                break
            readings = nearest_kernels.away_from(*readings, p_C, apart)
        return found or [Localization(-1, np.inf, np.zeros(3), np.zeros(3), seen, points)]

    def _limb(self, readings: Array, p_C: Array, R_CS: Array, p_CS: Array) -> tuple[int, Array, Array, float] | None:
        """Return link, point, normal (in C) and gap (m) where a limb around p_C touches, if one suits the readings."""
        p, s = self.params, self.shapes
        cloud = limb_kernels.readings_around(readings, p_C, p.limb_reach, _LIMB_READINGS)
        if len(cloud) < p.component:
            return None
        c, u, radius, first, last = limb_kernels.fit_limb(cloud)
        link, p_CT, d = limb_kernels.limb_contact(
            s.kind, s.size, s.link, R_CS, p_CS, c, u, radius, first, last, p.limb_softness
        )
        if abs(d - radius) > p.limb_gap or np.sum((p_CT - p_C) ** 2) > p.limb_reach**2:
            return None
        _, _, p_CT, n_C = nearest_surface_point(s.kind, s.size, R_CS, p_CS, s.link == link, p_CT)
        return link, p_CT, n_C, d - radius

    def on_surface(self, link: int, p_L: Array) -> tuple[Array, Array]:
        """Return the surface point of a link nearest to p_L and the outward normal there, all in the link's frame."""
        s = self.shapes
        _, _, p_LC, n_L = nearest_surface_point(s.kind, s.size, s.R_LS, s.p_LS, s.link == link, p_L)
        return p_LC, n_L
