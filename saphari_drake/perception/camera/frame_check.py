"""What single frames of a fixed camera show of its faults: a blind patch, too much noise, another place."""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.parameters import require_positive
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Depth = NDArray[np.float32]
_NEAR = 8.0  # deviations of the noise within which a reading may be of the background


@dataclass
class FrameCheckParameters:
    """What a sound frame may show. Assumed, but for the noise."""

    # m; deviation of a reading at this depth (m), with the square of which it grows. Measured with a Kinect v1.
    sigma: float = 0.004
    sigma_depth: float = 1.7
    # Times that deviation, the background's own included, above which a frame is too noisy.
    noise_factor: float = 1.9
    # Spacing of the pixels that are used, and edge of a tile (pixels).
    stride: int = 8
    tile: int = 40
    # Share of a tile's pixels that have a reading, where the background has one, below which it is blind; and how many
    # tiles may be. What absorbs or is too near takes a few.
    tile_share: float = 0.1
    blind_tiles: int = 4
    # Mean of the readings beyond the background, in deviations, and median of those on the robot beyond its model (m),
    # above which the camera was moved.
    floor_offset: float = 1.0
    robot_offset: float = 0.01
    # Share of the robot's points that are seen through: readings behind them, by more than this and 4 deviations (m).
    through_share: float = 0.08
    through: float = 0.015
    # Points on the robot, and the least that must be seen for an answer.
    points: int = 400
    least_points: int = 60
    # Frames in a row that decide for a fault, and against it.
    frames: int = 2
    good_frames: int = 5

    def __post_init__(self) -> None:
        require_positive(self, *self.__dataclass_fields__)
        for name in ("tile_share", "through_share"):
            if getattr(self, name) >= 1.0:
                raise ParameterError(name, f"must lie below 1, got {getattr(self, name)}")


class FrameStatus(IntEnum):
    """What is wrong with a camera's frames, also published as a number."""

    OK = 0
    BLIND = 1  # a patch without readings
    NOISY = 2
    MOVED = 3  # background or robot are not where they are taken to be, or something is seen through them


class FrameFigures(NamedTuple):
    """What was measured in a frame; NaN where there was too little of it."""

    blind: int  # tiles
    noise: float  # deviations
    floor: float  # deviations, mean offset of the background
    robot: float  # m, median offset of the robot
    through: float  # share of the robot's points

    def status(self, params: FrameCheckParameters) -> FrameStatus:
        """Return what is wrong; a moved camera is told before a noisy one, for both blur the background."""
        p = params
        if self.blind > p.blind_tiles:
            return FrameStatus.BLIND
        if abs(self.floor) > p.floor_offset or abs(self.robot) > p.robot_offset or self.through > p.through_share:
            return FrameStatus.MOVED
        return FrameStatus.NOISY if self.noise > p.noise_factor else FrameStatus.OK


class SurfacePoints(NamedTuple):
    """Points on a robot's surface, in the frames of their links (−1: the world)."""

    link: NDArray[np.int64]  # (k,)
    p_L: Array  # (k, 3) m
    n_L: Array  # (k, 3) outward normals


def surface_points(robot: RobotModel, count: int) -> SurfacePoints:
    """Return points spread over the surface of a robot's shapes, outside of the link's other shapes.

    Raises
    ------
    ParameterError
        If the robot has no shapes.
    """
    shapes, rng = robot.shapes, np.random.default_rng(0)
    if shapes.count == 0:
        raise ParameterError("robot", f"{robot.name} has no collision shapes to be seen by")
    links: list[int] = []
    points, normals = [], []
    tries = 0
    while len(links) < count and tries < 20 * count:
        tries += 1
        s = rng.integers(shapes.count)
        reach = 2.0 * np.max(shapes.size[s])
        p_L = shapes.p_LS[s] + shapes.R_LS[s] @ rng.uniform(-reach, reach, 3)
        own = shapes.link == shapes.link[s]
        _, distance, surface, normal = nearest_surface_point(
            shapes.kind, shapes.size, shapes.R_LS, shapes.p_LS, own, p_L
        )
        if distance > 0.0:
            links.append(shapes.link[s])
            points.append(surface)
            normals.append(normal)
    return SurfacePoints(np.array(links, dtype=np.int64), np.array(points), np.array(normals))


@njit(cache=True)
def background_figures(image, background, params):
    """Return blind tiles, noise and mean offset (deviations) of an image (height, width) against its background (m)."""
    stride, tile, sigma, sigma_depth, share = params
    rows, columns = image.shape[0] // tile + 1, image.shape[1] // tile + 1
    expected, seen = np.zeros((rows, columns)), np.zeros((rows, columns))
    count, offset, spread = 0, 0.0, 0.0
    for i in range(stride // 2, image.shape[0], stride):
        for j in range(stride // 2, image.shape[1], stride):
            z, z_B = image[i, j], background[i, j]
            if not np.isfinite(z_B):
                continue
            expected[i // tile, j // tile] += 1.0
            if not (z > 0.0 and np.isfinite(z)):
                continue
            seen[i // tile, j // tile] += 1.0
            d = (z - z_B) / (sigma * (z_B / sigma_depth) ** 2)
            if abs(d) < _NEAR:
                count += 1
                offset += d
                spread += abs(d)
    whole, blind = (tile // stride) ** 2, 0
    for i in range(rows):
        for j in range(columns):
            if expected[i, j] >= 0.8 * whole and seen[i, j] < share * expected[i, j]:
                blind += 1
    if count < 100:
        return blind, np.nan, np.nan
    return blind, spread / count / 0.8, offset / count


@njit(cache=True)
def robot_offsets(image, p_C, n_C, optics, through, sigma, sigma_depth):
    """Return by how much readings lie behind points (k, 3) of the robot that face the camera (m), in C, and the share.

    Something in front of a point, a person or the robot itself, hides it: such readings do not count.
    """
    fx, fy, cx, cy = optics
    found, behind, count = np.empty(p_C.shape[0]), 0, 0
    for k in range(p_C.shape[0]):
        x, y, z = p_C[k]
        facing = -(x * n_C[k, 0] + y * n_C[k, 1] + z * n_C[k, 2])
        if z <= 0.1 or facing < 0.35 * np.sqrt(x * x + y * y + z * z):
            continue
        i, j = int(np.floor(fy * y / z + cy)), int(np.floor(fx * x / z + cx))
        if not (0 <= i < image.shape[0] and 0 <= j < image.shape[1]):
            continue
        seen = image[i, j]
        if not (seen > 0.0 and np.isfinite(seen)) or seen - z < -0.05:
            continue
        if seen - z > through + 4.0 * sigma * (z / sigma_depth) ** 2:
            behind += 1
        found[count] = seen - z
        count += 1
    return found[:count], behind / max(count, 1)
