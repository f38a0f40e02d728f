"""From clouds of points to few obstacle points with velocities: a moving k-means with an alpha–beta filter."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.messages import Immutable
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.obstacles.track_kernels import apart, means, nearest_center, reach

Array = NDArray[np.float64]


@dataclass
class ObstacleTrackerParameters:
    """How the camera's points become obstacle points."""

    # s; time between looks at the camera.
    period: float = 0.01
    # m; edge of the cubes in which points are averaged first.
    voxel: float = 0.03
    # m; distance between obstacle points that is aimed at, and most of them.
    spacing: float = 0.10
    most: int = 40
    # m; distance beyond which a point is not taken for one of an obstacle point seen before.
    gate: float = 0.20
    # 0 … 1; gains of the alpha–beta filter on position and velocity. Assumed.
    alpha: float = 0.6
    beta: float = 0.2
    # m; distance over which obstacle points share their velocity: neighbours belong to one limb. 0: none do.
    share: float = 0.15
    # m/s; nothing that is tracked moves faster.
    max_speed: float = 3.0
    # m; half the thickness of what the camera sees, along the line of sight. Half an upper arm or forearm. Assumed.
    thickness: float = 0.05
    # s; how long an obstacle point that is not seen any more is held.
    hold: float = 0.3
    # s; time without a frame after which the camera is lost.
    timeout: float = 0.15
    # 0 … 1; least share of the pixels that can be read, of those that have a background.
    least_seen: float = 0.5
    # m; height in the world below which nothing is tracked: the floor and the robot's wheels.
    lowest: float = 0.12
    # Points that an obstacle has at least, after averaging; fewer are noise.
    least_points: int = 3

    def __post_init__(self) -> None:
        require_positive(
            self, "period", "voxel", "spacing", "most", "gate", "alpha", "max_speed", "timeout", "least_points"
        )
        require_non_negative(self, "beta", "share", "thickness", "hold", "least_seen")
        if not math.isfinite(self.lowest):
            raise ParameterError("lowest", f"must be finite, got {self.lowest}")
        if self.alpha > 1.0 or self.beta > 1.0 or self.least_seen > 1.0:
            raise ParameterError("alpha", "alpha, beta and least_seen must not exceed 1")


@dataclass(frozen=True)
class Tracks(Immutable):
    """Obstacle points and what is known of them.

    Attributes
    ----------
    p_W, v_W : (m, 3) arrays
        Positions (m) and velocities (m/s) in the world.
    extent : (m,) array
        Distance within which the points lie that each stands for (m).
    unseen : (m,) array
        Time since each was last seen (s).
    age : (m,) int array
        Frames in which each was seen.
    """

    p_W: Array
    v_W: Array
    extent: Array
    unseen: Array
    age: NDArray[np.int64]


NO_TRACKS = Tracks(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64))


def voxel_means(points: Array, size: float) -> Array:
    """Return the mean of the points (k, 3) in each cube of edge `size` (m) that holds any."""
    if len(points) == 0:
        return np.zeros((0, 3))
    cells = np.floor(points / size).astype(np.int64)
    cells -= cells.min(axis=0)
    span = cells.max(axis=0) + 1
    key = (cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2]
    _, group, count = np.unique(key, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(group, weights=column, minlength=count.size) for column in points.T], axis=1)
    return sums / count[:, None]


def update_tracks(tracks: Tracks, points: Array, half: Array, dt: float, params: ObstacleTrackerParameters) -> Tracks:
    """Bring obstacle points up to date with what one frame shows.

    Each point of the frame belongs to the nearest predicted obstacle point within the gate; the mean of what belongs to
    it is its measurement, so that obstacle points ride along with what they stand for. What belongs to none makes new
    ones, `spacing` apart. Of two that have come closer than half of that, the younger is dropped. One that is not seen
    stays where it was last seen, for `hold`.

    `extent` grows with what belongs to an obstacle point, so that the whole frame is covered also by no more than
    `most`.

    Parameters
    ----------
    tracks : Tracks
    points : (k, 3) array
        The frame's points in the world (m), averaged: the middle of the body there.
    half : (k, 3) array
        From there to its surface away from the camera (m); the other way it reaches as far.
    dt : float
        Time since the frame before (s).
    params : ObstacleTrackerParameters
    """
    predicted = tracks.p_W + dt * tracks.v_W
    owner = nearest_center(points, predicted, params.gate)
    seen = np.bincount(owner[owner >= 0], minlength=len(predicted)) > 0
    p, v = predicted.copy(), tracks.v_W.copy()
    p[~seen], v[~seen] = tracks.p_W[~seen], 0.0
    middle = means(points, owner, len(predicted))
    for j in np.flatnonzero(seen):
        innovation = middle[j] - predicted[j]
        alpha, beta = _gains(int(tracks.age[j]), params)
        p[j] += alpha * innovation
        v[j] += beta * innovation / dt
    v = _shared(p, v, seen, params.share)
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    v *= np.minimum(1.0, params.max_speed / np.maximum(speed, 1e-12))
    unseen, age = np.where(seen, 0.0, tracks.unseen + dt), tracks.age + seen
    keep = _apart(p, age, seen, 0.5 * params.spacing) & (unseen <= params.hold + 1e-9)
    p, v, unseen, age, seen = p[keep], v[keep], unseen[keep], age[keep], seen[keep]
    fresh = _new_centers(points, p[seen], params, max(params.most - len(p), 0))
    p = np.vstack([p, fresh])
    v = np.vstack([v, _velocity_nearby(fresh, p[: len(v)], v, params)])
    unseen = np.concatenate([unseen, np.zeros(len(fresh))])
    age = np.concatenate([age, np.ones(len(fresh), dtype=np.int64)])
    return Tracks(p, v, _extents(points, half, p, unseen, params), unseen, age)


def _gains(age: int, params: ObstacleTrackerParameters) -> tuple[float, float]:
    """Gains of a track seen `age` times before: those of the best line through so few samples, until they are less."""
    k = age + 1
    alpha = 2.0 * (2.0 * k - 1.0) / (k * (k + 1.0))
    beta = 6.0 / (k * (k + 1.0)) if k > 1 else 0.0
    return max(min(alpha, 1.0), params.alpha), max(min(beta, 1.0), params.beta)


def _shared(p: Array, v: Array, seen: NDArray[np.bool_], reach: float) -> Array:
    """Average velocities (m, 3) over the neighbours within `reach`, weighted by distance; unseen ones do not count."""
    if reach <= 0.0 or not np.any(seen):
        return v
    away = np.linalg.norm(p[:, None] - p[None], axis=2)
    weight = np.clip(1.0 - away / reach, 0.0, None) * seen
    total = weight.sum(axis=1, keepdims=True)
    return np.where(seen[:, None], weight @ v / np.maximum(total, 1e-12), v)


def _apart(p: Array, age: NDArray[np.int64], seen: NDArray[np.bool_], least: float) -> NDArray[np.bool_]:
    """Which of the points to keep, seen and old ones first, so that none lie closer than `least`."""
    keep: NDArray[np.bool_] = apart(p, np.lexsort((-age, ~seen)), least)
    return keep


def _new_centers(points: Array, centers: Array, params: ObstacleTrackerParameters, room: int) -> Array:
    """Return points (j, 3), farthest first, until all points lie within `spacing` of a center or `room` is used up."""
    if len(points) == 0:
        return np.zeros((0, 3))
    away = np.full(len(points), np.inf)
    if len(centers):
        away = np.min(np.linalg.norm(points[:, None] - centers[None], axis=2), axis=1)
    fresh: list[Array] = []
    while len(fresh) < room:
        k = int(np.argmax(away))
        if away[k] <= params.spacing:
            break
        # The mean of what is around it: a single far point would sit on the rim.
        around = points[np.linalg.norm(points - points[k], axis=1) <= params.spacing]
        if len(around) < params.least_points:
            away[k] = 0.0
            continue
        center = around.mean(axis=0)
        fresh.append(center)
        away = np.minimum(away, np.linalg.norm(points - center, axis=1))
        away[k] = 0.0
    return np.array(fresh).reshape(-1, 3)


def _velocity_nearby(fresh: Array, p: Array, v: Array, params: ObstacleTrackerParameters) -> Array:
    """Velocity that new obstacle points start with: that of the nearest one within the gate, or none."""
    if len(v) == 0:
        return np.zeros_like(fresh)
    owner = nearest_center(fresh, p, params.gate)
    return np.where((owner >= 0)[:, None], v[owner], 0.0)


def _extents(points: Array, half: Array, p: Array, unseen: Array, params: ObstacleTrackerParameters) -> Array:
    """Distance from each obstacle point to the farthest part of the body that belongs to it."""
    cube = 0.5 * np.sqrt(3.0) * params.voxel
    extent = np.where(unseen > 0.0, params.spacing + params.thickness, cube)
    reach(points, half, nearest_center(points, p, np.inf), p, cube, extent)
    return extent
