"""Whether a camera sees what touches the robot, by the exact depth image: for judging alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.perception.camera.model import CameraParameters, back_projected, camera_pose, ray_tables
from saphari_drake.robots.dynamics import DynamicsTerms
from saphari_drake.robots.model import RobotModel

_OFF = 0.001  # m; what is nearer to the robot's surface is the robot


def pixels_near(
    image: NDArray[np.float32],
    camera: CameraParameters,
    robot: RobotModel,
    terms: DynamicsTerms,
    p_W: NDArray[np.float64],
    radius: float,
) -> int:
    """Return how many pixels of an exact depth image show something near a point that is not the robot.

    Parameters
    ----------
    image : (height, width) float32 array
        m; zero or not finite: no reading.
    terms : DynamicsTerms
        Of the robot when the image was taken.
    p_W : (3,) array
        The point in the world (m).
    radius : float
        How near (m).
    """
    X_WC = camera_pose(camera)
    x, y = ray_tables(camera)
    p_C = X_WC.inverse() @ p_W
    if p_C[2] < camera.near:
        return 0
    reach = radius / p_C[2] * 1.3
    cols = np.flatnonzero(np.abs(x - p_C[0] / p_C[2]) < reach)
    rows = np.flatnonzero(np.abs(y - p_C[1] / p_C[2]) < reach)
    if len(cols) == 0 or len(rows) == 0:
        return 0
    z = image[np.ix_(rows, cols)]
    z = np.where(np.isfinite(z), z, 0.0)
    points = back_projected(x[cols], y[rows], z).reshape(-1, 3).astype(float)
    points = points[np.linalg.norm(points - p_C, axis=1) < radius]
    points = points @ X_WC.rotation().matrix().T + X_WC.translation()
    shapes, everything = robot.shapes, np.ones(robot.shapes.count, dtype=bool)
    R_WS, p_WS = shapes.in_world(terms.R_WL, terms.p_WL)
    return sum(
        nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, everything, point)[1] > _OFF for point in points
    )
