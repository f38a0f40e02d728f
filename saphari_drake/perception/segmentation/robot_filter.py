"""The robot and the static background taken out of a depth image: what is left is the person."""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import Primitives, bounding_capsules
from saphari_drake.perception.camera.model import CameraParameters, camera_pose, pinhole
from saphari_drake.perception.segmentation.distances import RobotDistance, distances
from saphari_drake.perception.segmentation.parameters import SegmentationParameters, Tuning
from saphari_drake.perception.segmentation.person import Readings, human_mask, human_points, person_readings
from saphari_drake.perception.segmentation.regions import Region, region_near, share_seen
from saphari_drake.robots.shapes import LinkShapes

Array = NDArray[np.float64]
Depth = NDArray[np.float32]


class Person(NamedTuple):
    """What one depth image shows of a person."""

    depth: Depth  # (height, width) m, the image
    seen: float  # share of the robot's visible axis points that have a reading
    points: Array  # (k, 3) m, the person's points in the world
    readings: Readings  # those near the robot, in C
    shapes: Primitives  # the robot in C


class RobotFilter:
    """Removes a robot and the background from the images of one camera; holds constants only.

    Parameters
    ----------
    shapes : LinkShapes
        The robot's surface.
    camera : CameraParameters
    params : SegmentationParameters
    background : (height, width) float32 array, optional
        As `background_depth` gives it; default: nothing but the robot and the person is in view.
    X_WC : RigidTransform, optional
        Pose of the camera, such as a corrected one; default: that of its parameters.

    Raises
    ------
    ParameterError
        If the background has another size than the image, or the robot has more than 127 shapes.
    """

    def __init__(
        self,
        shapes: LinkShapes,
        camera: CameraParameters,
        params: SegmentationParameters,
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
        self.shapes, self.tuning, self.pinhole = shapes, params.tuning, pinhole(camera)
        self._X_WC = camera_pose(camera) if X_WC is None else X_WC
        self._stands_at(self._X_WC)
        limit = np.full(size, np.inf)
        margin = params.background_margin * params.scale(background)
        np.subtract(background, margin, out=limit, where=np.isfinite(background))
        self.limit = limit.astype(np.float32)
        self._bounds = bounding_capsules(shapes.kind, shapes.size)
        links = shapes.link.max(initial=0) + 1
        self.person(np.zeros(size, np.float32), np.tile(np.eye(3), (links, 1, 1)), np.zeros((links, 3)))  # compiles

    def _stands_at(self, X_WC: RigidTransform) -> None:
        self.R_WC, self.p_WC = np.ascontiguousarray(X_WC.rotation().matrix()), np.array(X_WC.translation())

    def corrected(self, X_correct: RigidTransform) -> RobotFilter:
        """Return this filter with its camera at ``X_correct @ X_WC``, X_WC being where it was taken to be at first."""
        other = copy(self)
        other._stands_at(X_correct @ self._X_WC)
        return other

    def measured(
        self, depth: Depth, R_WL: Array, p_WL: Array, tuning: Tuning
    ) -> tuple[Primitives, Region, RobotDistance]:
        """Return the robot's shapes in C, the region around it, and how far the foreground there is from it."""
        R_WS, p_WS = self.shapes.in_world(R_WL, p_WL)
        R_CS, p_CS = self.R_WC.T @ R_WS, (p_WS - self.p_WC) @ self.R_WC
        shapes = Primitives(self.shapes.kind, self.shapes.size, self.shapes.link, R_CS, p_CS)
        region = region_near(shapes, self._bounds, tuning.reach, self.pinhole)
        return shapes, region, distances(depth, self.limit, self.pinhole, shapes, region, tuning)

    def person(self, depth: Depth, R_WL: Array, p_WL: Array) -> Person:
        """Return what an image shows of a person.

        Parameters
        ----------
        depth : (height, width) float32 array
            Depth image (m); 0, NaN and +inf are no reading.
        R_WL, p_WL : (n, 3, 3) and (n, 3) arrays
            Poses of the links when the image was taken.
        """
        tuning = self.tuning
        depth = depth.view()
        depth.flags.writeable = False  # as a port gives it: compiled passes know it by that
        shapes, region, near = self.measured(depth, R_WL, p_WL, tuning)
        human = human_mask(depth, near, region, tuning)
        points = human_points(depth, self.limit, self.pinhole, near.best, human, region, tuning)
        return Person(
            depth,
            share_seen(depth, shapes, self._bounds, self.pinhole),
            self.in_world(points),
            person_readings(depth, self.pinhole, near, human, region, tuning.reach),
            shapes,
        )

    def in_world(self, p_C: Array) -> Array:
        """Return points (k, 3) of the camera frame in the world (m)."""
        return p_C @ self.R_WC.T + self.p_WC
