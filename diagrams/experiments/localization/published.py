"""The contact localisation that was published with the deliverable, plainly done: the baseline to compare with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.perception.segmentation.distances import BORDER
from saphari_drake.perception.segmentation.robot_filter import Depth, RobotFilter
from saphari_drake.robots.dynamics import DynamicsTerms

Array = NDArray[np.float64]


class PublishedResult(NamedTuple):
    """Link (−1: nothing found), contact point (3,) in it (m), and force (3,) on the robot (N, world)."""

    link: int
    p_L: Array
    F_W: Array


def published_localization(
    camera: RobotFilter, depth: Depth, terms: DynamicsTerms, r: Array, threshold: float, removal: float = 0.02
) -> PublishedResult:
    """Return the point of the touched link that is nearest to any reading off the robot.

    The link is that of the last residual beyond `threshold` (Nm). Readings within `removal` (m) of the robot's model
    are removed as the robot itself; the nearest of the rest is projected on the link. The force is the pseudo-inverse
    of eq. (51). If no reading is within reach, nothing is found.
    """
    felt = np.flatnonzero(np.abs(r) > threshold)
    if len(felt) == 0:
        return PublishedResult(-1, np.zeros(3), np.zeros(3))
    link, shapes = int(felt[-1]), camera.shapes
    tuning = camera.tuning._replace(
        seed_distance=removal, grow_distance=0.5 * removal, scale_depth=1e6, least_scale=1.0
    )
    _, region, near = camera.measured(depth, terms.R_WL, terms.p_WL, tuning)
    rows, cols = np.nonzero(near.strong[BORDER:-BORDER, BORDER:-BORDER])
    rows, cols = rows + region.r0, cols + region.c0
    z = depth[rows, cols].astype(float)
    points = camera.in_world(np.column_stack([camera.pinhole.x[cols] * z, camera.pinhole.y[rows] * z, z]))
    if len(points) == 0:
        return PublishedResult(-1, np.zeros(3), np.zeros(3))
    p_L = (points - terms.p_WL[link]) @ terms.R_WL[link]
    own = np.flatnonzero(shapes.link == link)
    axial = np.min([_axis_distance(p_L, shapes.R_LS[s], shapes.p_LS[s], shapes.size[s]) for s in own], axis=0)
    nearest = p_L[np.argmin(axial)]
    p_LC, _ = shapes.nearest_on(link, nearest)
    F = np.linalg.pinv(terms.point(link, p_LC).Jv_WC.T) @ r
    return PublishedResult(link, p_LC, F)


def _axis_distance(points: Array, R: Array, p: Array, size: Array) -> Array:
    local = (points - p) @ R
    local[:, 2] -= np.clip(local[:, 2], -size[1], size[1])
    return np.linalg.norm(local, axis=1) - size[0]
