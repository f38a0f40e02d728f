"""Camera self-check: with the person away, the robot's own depth against its model shows where the camera really is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.compiled import njit
from saphari_drake.errors import ParameterError, StateError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.parameters import require_positive
from saphari_drake.perception.camera.model import CameraParameters, back_projected, camera_pose, ray_tables
from saphari_drake.perception.camera.open3d_import import import_open3d
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Depth = NDArray[np.float32]


@dataclass
class CameraCheckParameters:
    """Numbers of the camera self-check."""

    # Displacement of the robot in the image above which the camera's pose is doubted (m, > 0).
    warning: float = 0.005
    # Distance from the model within which a reading belongs to the robot (m, > 0).
    reach: float = 0.04
    # Spacing of the pixels that are used (pixels, ≥ 1), and least number of readings for an answer (≥ 6).
    stride: int = 2
    least_points: int = 500
    # Largest angle between surface and view for a reading to count (cosine of it, 0–1): grazing ones are biased.
    least_cosine: float = 0.4
    # Rounds of the registration (≥ 1).
    iterations: int = 60

    def __post_init__(self) -> None:
        require_positive(self, "warning", "reach", "stride", "least_points", "least_cosine", "iterations")
        if self.least_points < 6:
            raise ParameterError("least_points", f"must be at least 6, got {self.least_points}")
        if self.least_cosine > 1.0:
            raise ParameterError("least_cosine", f"must not exceed 1, got {self.least_cosine}")


class CheckStatus(IntEnum):
    """What the self-check found, also as a number."""

    UNKNOWN = 0  # too little of the robot is seen
    OK = 1
    WARNING = 2  # the camera is displaced by more than allowed
    BUSY = 3  # a person is in view: nothing is compared, and the last error stands


class CheckResult(NamedTuple):
    """Result of a self-check.

    Attributes
    ----------
    status : CheckStatus
    X_correct : RigidTransform
        Correction in the world: the true pose is ``X_correct @ X_WC``.
    displacement : float
        Mean displacement of the robot's seen points by it (m).
    turn : float
        Its angle (rad).
    residual_before, residual_after : float
        Root mean square distance of the readings from the model's surface (m).
    points : int
        Readings used.
    """

    status: CheckStatus
    X_correct: RigidTransform
    displacement: float
    turn: float
    residual_before: float
    residual_after: float
    points: int


def check_camera(
    robot: RobotModel,
    camera: CameraParameters,
    postures: Sequence[Array],
    images: Sequence[Depth],
    params: CameraCheckParameters | None = None,
    X_WC: RigidTransform | None = None,
) -> CheckResult:
    """Compare what a camera sees of the robot, in one or more postures and with nobody near, with the model.

    Readings near the modelled robot are registered to its surface by Open3D's point-to-plane step, robust to readings
    of other things. One posture shows an error; for a correction take several that differ: a straight arm
    can't show a turn about itself.

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
    motions = [robot.kinematics(robot.checked_vector(q, "postures")) for q in postures]
    kinematics = [robot.shapes.in_world(motion.R_WL, motion.p_WL) for motion in motions]
    clouds = [_readings(camera, np.asarray(image), params) for image in images]
    clouds = [
        X_WC.inverse().multiply(_matches(robot, [pose], [cloud], X_WC, 3.0 * params.reach, -1.0)[0].T).T
        for pose, cloud in zip(kinematics, clouds)
    ]
    X = RigidTransform()
    before = after = np.nan
    used = 0
    reach = params.reach
    for turn in range(4):  # readings of other things count less each time
        seen, target, normal = _matches(robot, kinematics, clouds, X @ X_WC, reach, params.least_cosine)
        used = len(seen)
        if used < params.least_points:
            return CheckResult(CheckStatus.UNKNOWN, RigidTransform(), np.nan, np.nan, np.nan, np.nan, used)
        if turn == 0:
            before = _rms(seen, target, normal)
            middle = seen
        X = _registered(robot, kinematics, clouds, X, X_WC, reach, params)
        reach = max(0.6 * reach, 0.015)
    seen, target, normal = _matches(robot, kinematics, clouds, X @ X_WC, reach, params.least_cosine)
    after = _rms(seen, target, normal)
    displacement = float(np.mean(np.linalg.norm(middle - (X.inverse() @ middle.T).T, axis=1)))
    status = CheckStatus.WARNING if displacement > params.warning else CheckStatus.OK
    return CheckResult(status, X, displacement, X.rotation().ToAngleAxis().angle(), before, after, used)


def _readings(camera: CameraParameters, image: Depth, params: CameraCheckParameters) -> Array:
    """Return the readings in the camera frame (k, 3), m, away from steps of depth."""
    z = np.where(np.isfinite(image), image, 0.0).astype(float)
    step = np.full(z.shape, np.inf)
    core = z[2:-2, 2:-2]
    shifted = [z[2 + i : z.shape[0] - 2 + i, 2 + j : z.shape[1] - 2 + j] for i in (-2, 0, 2) for j in (-2, 0, 2)]
    step[2:-2, 2:-2] = np.max([np.abs(other - core) for other in shifted], axis=0)
    points = back_projected(*ray_tables(camera), z)
    chosen = np.zeros(z.shape, dtype=bool)
    chosen[:: int(params.stride), :: int(params.stride)] = True
    return points[chosen & (z > 0.0) & (step < 0.04)]


def _matches(
    robot: RobotModel, kinematics: list[tuple[Array, Array]], clouds: list[Array], X_WC: RigidTransform, reach: float,
    least_cosine: float,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return readings near the robot, their projections on it and the normals there, all in the world (k, 3)."""
    shapes, parts = robot.shapes, []
    for (R_WS, p_WS), cloud in zip(kinematics, clouds):
        points = cloud @ X_WC.rotation().matrix().T + X_WC.translation()
        parts.append(_on_surface(shapes.kind, shapes.size, R_WS, p_WS, points, X_WC.translation(), reach, least_cosine))
    seen, target, normal = (np.concatenate(rows) for rows in zip(*parts))
    return seen, target, normal


@njit(cache=True)
def _on_surface(kind, size, R_WS, p_WS, points, eye, reach, least_cosine):
    """Return the points within `reach` (m) of the shapes and seen steeply enough, their projections and normals."""
    everything = np.ones(kind.shape[0], np.bool_)
    seen, target, normal = np.empty(points.shape), np.empty(points.shape), np.empty(points.shape)
    count = 0
    for k in range(points.shape[0]):
        _, distance, surface, n = nearest_surface_point(kind, size, R_WS, p_WS, everything, points[k])
        if abs(distance) < reach:
            view = eye - points[k]
            if np.sum(n * view) > least_cosine * np.sqrt(np.sum(view * view)):
                seen[count], target[count], normal[count] = points[k], surface, n
                count += 1
    return seen[:count], target[:count], normal[:count]


def _registered(
    robot: RobotModel, kinematics: list[tuple[Array, Array]], clouds: list[Array], X: RigidTransform,
    X_WC: RigidTransform, reach: float, params: CameraCheckParameters,
) -> RigidTransform:  # fmt: skip
    """Return the correction after a point-to-plane registration of all postures at once, starting from X.

    Each round pairs every reading with the nearest point of the model's surface in its own posture, and Open3D solves
    for the one motion of the camera that suits all pairs.
    """
    o3d = import_open3d()
    loss = o3d.pipelines.registration.TukeyLoss(reach)
    method = o3d.pipelines.registration.TransformationEstimationPointToPlane(loss)
    for _ in range(max(int(params.iterations) // 4, 1)):
        seen, target, normal = _matches(robot, kinematics, clouds, X @ X_WC, reach, params.least_cosine)
        source, model = o3d.geometry.PointCloud(), o3d.geometry.PointCloud()
        source.points = o3d.utility.Vector3dVector(seen)
        model.points = o3d.utility.Vector3dVector(target)
        model.normals = o3d.utility.Vector3dVector(normal)
        pairs = o3d.utility.Vector2iVector(np.tile(np.arange(len(seen), dtype=np.int32)[:, None], (1, 2)))
        step = np.asarray(method.compute_transformation(source, model, pairs))
        change = RigidTransform(RotationMatrix.ProjectToRotationMatrix(step[:3, :3]), step[:3, 3])
        X = change @ X
        if np.linalg.norm(step - np.eye(4)) < 2e-5:
            break
    return X


def _rms(seen: Array, target: Array, normal: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((seen - target) * normal, axis=1) ** 2)))
