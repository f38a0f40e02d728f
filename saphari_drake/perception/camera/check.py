"""Camera self-check: with the person away, the robot's own depth against its model shows where the camera really is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.errors import StateError
from saphari_drake.perception.camera.check_parameters import CameraCheckParameters, CheckStatus
from saphari_drake.perception.camera.model import CameraParameters, camera_pose
from saphari_drake.perception.camera.registration import (
    Cloud,
    Registration,
    Sums,
    correction,
    mean_displacement,
    next_round,
    registered,
    robot_cloud,
    with_cloud,
)
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Depth = NDArray[np.float32]


class CheckResult(NamedTuple):
    """Result of a self-check.

    Attributes
    ----------
    status : CheckStatus
    X_correct : RigidTransform
        Correction in the world: the true pose is ``X_correct @ X_WC``.
    covariance : (6, 6) array
        Of the rotation vector (rad) and the shift (m) about the camera's centre that the correction leaves.
    displacement : float
        Mean displacement of the robot's seen points by it (m).
    turn : float
        Its angle (rad).
    residual_before, residual_after : float
        Root mean square distance of the readings from the model's surface (m).
    points : int
        Readings used.
    observable : int
        Directions, of six, in which the readings tell more than the prior.
    """

    status: CheckStatus
    X_correct: RigidTransform
    covariance: Array
    displacement: float
    turn: float
    residual_before: float
    residual_after: float
    points: int
    observable: int


def check_camera(
    robot: RobotModel,
    camera: CameraParameters,
    postures: Sequence[Array],
    images: Sequence[Depth],
    params: CameraCheckParameters | None = None,
    X_WC: RigidTransform | None = None,
) -> CheckResult:
    """Compare what a camera sees of the robot, in one or more postures and with nobody near, with the model.

    Readings near the modelled robot are registered to its surface, point to plane (Chen and Medioni 1992), by
    Gauss–Newton steps with Tukey's weights, so that readings of other things count little. One posture shows an error;
    for a correction take several that differ: a straight arm can't show a turn about itself. What the readings do not
    tell stays as it is: see `CameraCheckParameters` for the prior.

    Parameters
    ----------
    postures : sequence of (n,) arrays
        Joint positions at which the images were taken.
    images : sequence of (height, width) float32 arrays
        Depth (m); 0, NaN and +inf are no reading.
    X_WC : RigidTransform, optional
        Where the camera is taken to be; default: the pose of its parameters.

    Raises
    ------
    StateError
        If postures and images differ in number, or there are none.
    """
    params = params or CameraCheckParameters()
    if len(postures) != len(images) or len(images) == 0:
        raise StateError(f"images: one a posture is needed, got {len(images)} for {len(postures)} postures")
    X_WC = camera_pose(camera) if X_WC is None else X_WC
    postures = [robot.checked_vector(q, "postures") for q in postures]
    clouds = [robot_cloud(robot, camera, q, image, params, X_WC) for q, image in zip(postures, images)]
    search = Registration()
    while not registered(search, params):
        sums = Sums()
        for cloud in clouds:
            sums = with_cloud(sums, robot, cloud, search, params, X_WC)
        search = next_round(search, sums, params)
    return check_result(clouds, search, params, X_WC)


def check_result(
    clouds: Sequence[Cloud], search: Registration, params: CameraCheckParameters, X_WC: RigidTransform
) -> CheckResult:
    """Return what a finished search says: a correction within its bounds, or none."""
    p, nothing = params, RigidTransform()
    prior = p.prior()
    if search.points < p.least_points:
        return CheckResult(CheckStatus.UNKNOWN, nothing, prior, np.nan, np.nan, np.nan, np.nan, search.points, 0)
    X = correction(search.x, X_WC)
    displacement = float(np.mean([mean_displacement(np.zeros(6), search.x, cloud, X_WC) for cloud in clouds]))
    turn = float(np.linalg.norm(search.x[:3]))
    status = CheckStatus.WARNING if displacement > p.warning else CheckStatus.OK
    if turn > p.most_turn or np.linalg.norm(search.x[3:]) > p.most_shift:
        X, status = nothing, CheckStatus.BEYOND
    figures = displacement, turn, search.before, search.after, search.points, search.observable
    return CheckResult(status, X, prior if status == CheckStatus.BEYOND else search.covariance, *figures)
