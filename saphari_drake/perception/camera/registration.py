"""What a camera sees of a robot, registered to the robot's model: readings near its surface, point to plane.

Y. Chen, G. Medioni, "Object modelling by registration of multiple range images", 1992; with Tukey's weights. What is
sought is a small turn and shift of the camera about its centre, with a prior: see `CameraCheckParameters`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.math.rotations import axis_rotation
from saphari_drake.perception.camera.check_parameters import CameraCheckParameters
from saphari_drake.perception.camera.model import CameraParameters, back_projected, ray_tables
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Depth = NDArray[np.float32]

_STEP = 0.04  # m; beside a step of depth readings are mixed ones
_SHRINK = 0.85  # of the reach, from round to round
_SETTLED = 1e-3  # step in deviations of the prior that counts as none
_MOST_STEP = 0.5  # deviations of the prior, of a round


class Cloud(NamedTuple):
    """The robot in one posture: its shapes in the world, and readings near it in the camera frame."""

    R_WS: Array  # (s, 3, 3)
    p_WS: Array  # (s, 3) m
    p_C: Array  # (k, 3) m


class Sums(NamedTuple):
    """Normal equations of a round: information and right-hand side, readings, weights, and squared distances (m²)."""

    A: Array = np.zeros((6, 6))
    b: Array = np.zeros(6)
    points: int = 0
    weights: float = 0.0
    squares: float = 0.0
    clouds: int = 0  # that have been added


class Registration(NamedTuple):
    """How far the search for a correction has come."""

    x: Array = np.zeros(6)  # rotation vector (rad) and shift (m) about the camera's centre
    covariance: Array = np.zeros((6, 6))
    rounds: int = 0
    settled: bool = False  # whether nothing moved any more at the smallest reach
    points: int = 0
    observable: int = 0
    before: float = np.nan  # m, root mean square distance from the surface at first, and now
    after: float = np.nan


def robot_cloud(
    robot: RobotModel, camera: CameraParameters, q: Array, image: Depth, params: CameraCheckParameters,
    X_WC: RigidTransform, person: Array | None = None,
) -> Cloud:  # fmt: skip
    """Return the readings of an image (height, width) in m that may be of the robot at joint positions q (n,).

    Those nearer to a person's points (k, 3), in the world, than `person_distance` are left out.
    """
    motion, shapes = robot.kinematics(q), robot.shapes
    R_WS, p_WS = shapes.in_world(motion.R_WL, motion.p_WL)
    z, step = _thinned(np.asarray(image), int(params.stride))
    x, y = (table[2 : -2 : int(params.stride)] for table in ray_tables(camera))
    p_C = back_projected(x, y, z)[(z > 0.0) & (step < _STEP)]
    p_W = p_C @ X_WC.rotation().matrix().T + X_WC.translation()
    farthest = 2.0 * params.reach + np.linalg.norm(shapes.size, axis=1)
    low, high = (p_WS - farthest[:, None]).min(axis=0), (p_WS + farthest[:, None]).max(axis=0)
    around = np.flatnonzero(np.all((p_W > low) & (p_W < high), axis=1))
    near = around[_near(shapes.kind, shapes.size, R_WS, p_WS, p_W[around], 2.0 * params.reach)]
    if person is not None and len(person) > 0:
        near = near[_away(p_W[near], person, params.person_distance)]
    return Cloud(R_WS, p_WS, p_C[near[:: len(near) // int(params.most_points) + 1]])


def _thinned(image: Depth, stride: int) -> tuple[Array, Array]:
    """Return every `stride`-th depth inside the image's border (m), and the largest step to a reading nearby."""
    rows, cols = image.shape
    shifted = np.array(
        [
            image[2 + i : rows - 2 + i : stride, 2 + j : cols - 2 + j : stride]
            for i, j in ((0, 0), (-2, -2), (-2, 0), (-2, 2), (0, -2), (0, 2), (2, -2), (2, 0), (2, 2))
        ]
    )
    shifted[~np.isfinite(shifted)] = 0.0
    return shifted[0].astype(float), np.max(np.abs(shifted[1:] - shifted[0]), axis=0)


def registered(search: Registration, params: CameraCheckParameters) -> bool:
    """Whether a search has come to its end, with or without an answer."""
    enough = search.rounds == 0 or search.points >= params.least_points
    return not enough or search.rounds >= params.iterations or search.settled


def with_cloud(
    sums: Sums, robot: RobotModel, cloud: Cloud, search: Registration, params: CameraCheckParameters,
    X_WC: RigidTransform,
) -> Sums:  # fmt: skip
    """Return the sums of a round with those of one more posture, all of whose readings count as `independent` ones."""
    shapes, reach = robot.shapes, _reach(search, params)
    R_WC, p_WC = corrected(search.x, X_WC)
    moved = cloud.p_C @ R_WC.T + p_WC
    A, b, seen, weights, squares = _normal_equations(
        shapes.kind, shapes.size, cloud.R_WS, cloud.p_WS, moved, p_WC, search.x, reach, params.least_cosine
    )
    share = min(1.0, params.independent / max(seen, 1)) / params.sigma**2
    return Sums(
        sums.A + share * A,
        sums.b + share * b,
        sums.points + seen,
        sums.weights + weights,
        sums.squares + squares,
        sums.clouds + 1,
    )


def next_round(search: Registration, sums: Sums, params: CameraCheckParameters) -> Registration:
    """Return a search after the Gauss–Newton step of a round, in the directions alone that its readings tell of."""
    p = params
    if sums.points < p.least_points:
        return search._replace(rounds=search.rounds + 1, points=sums.points)
    scale = np.repeat([p.turn_prior, p.shift_prior], 3)
    value, V = np.linalg.eigh(scale[:, None] * sums.A * scale)
    known = value > p.least_information
    x = scale * (V @ (np.where(known, 1.0 / (1.0 + value), 0.0) * (V.T @ (scale * sums.b))))
    step = (x - search.x) / scale
    rms = float(np.sqrt(sums.squares / max(sums.weights, 1e-9)))
    return Registration(
        search.x + scale * np.clip(step, -_MOST_STEP, _MOST_STEP),
        scale[:, None] * ((V * np.where(known, 1.0 / (1.0 + value), 1.0)) @ V.T) * scale,
        search.rounds + 1,
        bool(_reach(search, p) == p.least_reach and np.linalg.norm(step) < _SETTLED),
        sums.points,
        int(np.count_nonzero(known)),
        rms if search.rounds == 0 else search.before,
        rms,
    )


def _reach(search: Registration, params: CameraCheckParameters) -> float:
    """Return the distance (m) from the surface within which readings count in this round."""
    return max(params.reach * _SHRINK**search.rounds, params.least_reach)


def corrected(x: Array, X_WC: RigidTransform) -> tuple[Array, Array]:
    """Return orientation (3, 3) and centre (3,) in m of a camera after a turn (rad) and shift (m) x (6,)."""
    angle = float(np.linalg.norm(x[:3]))
    R = axis_rotation(x[:3] / angle, angle) if angle > 0.0 else np.eye(3)
    return R @ X_WC.rotation().matrix(), X_WC.translation() + x[3:]


def correction(x: Array, X_WC: RigidTransform) -> RigidTransform:
    """Return the transform in the world by which a turn (rad) and shift (m) x (6,) of a camera moves what it sees."""
    R_WC, p_WC = corrected(x, X_WC)
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(R_WC), p_WC) @ X_WC.inverse()


def mean_displacement(x: Array, y: Array, cloud: Cloud, X_WC: RigidTransform) -> float:
    """Return by how much (m), in the mean, turns and shifts x and y (6,) of a camera see a cloud apart."""
    (R_x, p_x), (R_y, p_y) = corrected(x, X_WC), corrected(y, X_WC)
    apart = cloud.p_C @ (R_y - R_x).T + p_y - p_x
    return float(np.sqrt(np.sum(apart**2, axis=1)).mean()) if len(apart) else 0.0


@njit(cache=True)
def _near(kind, size, R_WS, p_WS, points, reach):
    """Return which points (k, 3) lie within `reach` (m) of the shapes' surface."""
    everything, near = np.ones(kind.shape[0], np.bool_), np.zeros(points.shape[0], np.bool_)
    for k in range(points.shape[0]):
        near[k] = abs(nearest_surface_point(kind, size, R_WS, p_WS, everything, points[k])[1]) < reach
    return near


@njit(cache=True)
def _away(points, person, distance):
    """Return which points (k, 3) lie at least `distance` (m) from all points of a person."""
    away = np.ones(points.shape[0], np.bool_)
    for k in range(points.shape[0]):
        for i in range(person.shape[0]):
            if np.sum((points[k] - person[i]) ** 2) < distance * distance:
                away[k] = False
                break
    return away


@njit(cache=True)
def _normal_equations(kind, size, R_WS, p_WS, points, eye, x, reach, least_cosine):
    """Return Σ w JᵀJ (6, 6) and Σ w Jᵀ(J x − e) (6,) over points (k, 3) near the shapes and seen steeply enough.

    J (6,) is how the distance e (m) from the surface grows with a turn about the camera's centre `eye` and a shift, w
    Tukey's weight. Also their number, Σ w and Σ w e².
    """
    everything = np.ones(kind.shape[0], np.bool_)
    A, b, J = np.zeros((6, 6)), np.zeros(6), np.empty(6)
    count, weights, squares = 0, 0.0, 0.0
    for k in range(points.shape[0]):
        p = points[k]
        _, e, _, n = nearest_surface_point(kind, size, R_WS, p_WS, everything, p)
        if abs(e) >= reach:
            continue
        view = eye - p
        if np.sum(n * view) <= least_cosine * np.sqrt(np.sum(view * view)):
            continue
        u = p - eye
        J[0], J[1], J[2] = u[1] * n[2] - u[2] * n[1], u[2] * n[0] - u[0] * n[2], u[0] * n[1] - u[1] * n[0]
        J[3], J[4], J[5] = n[0], n[1], n[2]
        w = (1.0 - (e / reach) ** 2) ** 2
        target = -e
        for i in range(6):
            target += J[i] * x[i]
        for i in range(6):
            b[i] += w * J[i] * target
            for j in range(6):
                A[i, j] += w * J[i] * J[j]
        count += 1
        weights += w
        squares += w * e * e
    return A, b, count, weights, squares
