"""Where a person touches a robot, from one depth image and the posture of the robot when it was taken."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.errors import ParameterError, StateError
from saphari_drake.math.geometry import bounding_capsules, nearest_surface_point
from saphari_drake.math.rotations import skew
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception import localizer_kernels as kernels
from saphari_drake.perception.image_regions import region_of, row_intervals, share_seen
from saphari_drake.perception.rgbd_camera import CameraParameters, camera_pose, ray_tables
from saphari_drake.robots.shapes import LinkShapes

Array = NDArray[np.float64]
Depth = NDArray[np.float32]


@dataclass
class LocalizerParameters:
    """Numbers of the contact localizer. Distances marked (s) hold at `scale_depth` and grow with the depth squared."""

    # Distance around the robot within which the image is examined (m, > 0).
    reach: float = 0.12
    # Distance from the robot beyond which a reading surely is no robot (m, s, > grow_distance).
    seed_distance: float = 0.020
    # Distance beyond which a reading within 4 pixels of such a one is none either (m, s, > 0).
    grow_distance: float = 0.008
    # Margin before the background within which a reading counts as background (m, s, > 0).
    background_margin: float = 0.020
    # Depth at which (s) holds (m, > 0), and the least factor by which a smaller depth shrinks it (0–1).
    scale_depth: float = 1.7
    least_scale: float = 0.25
    # Least number of the person's pixels in a 5 × 5 window (1–25) at depths that differ by less than this (m, s, > 0).
    support: int = 7
    support_step: float = 0.03
    # Least number of the person's pixels in a connected component (≥ 1).
    component: int = 25
    # Rank of the smallest distance that anchors the soft minimum (≥ 1), its width (m, > 0), its extent (m, > 0), and
    # how often it is centred anew (≥ 1).
    rank: int = 6
    softness: float = 0.005
    spread: float = 0.05
    rounds: int = 3
    # The camera sees the near side of what touches; its middle lies behind by this share (≥ 0) of the deviation of its
    # points across the view, at least and at most so far (m): what touches is about as thick as it is wide.
    thickness: float = 1.5
    least_thickness: float = 0.0065
    most_thickness: float = 0.019
    # Distance of the person below which a contact is possible (m, > 0).
    gate: float = 0.028
    # Spacing of the person's points that are published (pixels, ≥ 1).
    points_stride: int = 6
    # Least share of the robot's visible axis points that must have a reading (0–1) for a frame to be valid.
    least_seen: float = 0.5
    # Time without a frame after which the camera is stale (s, > 0), so that a controller can stop within 0.1 s.
    timeout: float = 0.08
    # Time constant of the contact point's smoothing over frames (s, > 0).
    time_constant: float = 0.15
    # Distance from the smoothed point beyond which a point on the same link starts the smoothing anew (m, > 0).
    jump: float = 0.04
    # Frames in a row that must show another link before it is taken while in contact (≥ 1).
    switch_frames: int = 2
    # Time over which postures are remembered (s, > 0); a frame that is older when it arrives is not used.
    memory: float = 0.3

    def __post_init__(self) -> None:
        require_positive(
            self, "reach", "seed_distance", "grow_distance", "background_margin", "scale_depth", "least_scale",
            "support", "support_step", "component", "rank", "softness", "spread", "rounds", "gate", "points_stride",
            "timeout", "time_constant", "jump", "switch_frames", "memory",
        )  # fmt: skip
        require_non_negative(self, "thickness", "least_thickness", "most_thickness")
        if self.most_thickness < self.least_thickness:
            raise ParameterError("most_thickness", f"must not be below least_thickness, got {self.most_thickness}")
        if self.grow_distance >= self.seed_distance:
            raise ParameterError("grow_distance", f"must be below seed_distance, got {self.grow_distance}")
        if self.least_scale > 1.0:
            raise ParameterError("least_scale", f"must not exceed 1, got {self.least_scale}")
        if self.support > 25:
            raise ParameterError("support", f"a window has 25 pixels, got {self.support}")
        if not 0.0 <= self.least_seen <= 1.0:
            raise ParameterError("least_seen", f"must lie in 0–1, got {self.least_seen}")
        if self.gate > self.reach:
            raise ParameterError("gate", f"must not exceed reach ({self.reach} m), got {self.gate}")


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
    """

    link: int
    distance: float
    p_LC: Array
    n_L: Array
    seen: float
    human_points: Array
    width: float = 0.0


def background_depth(frames: Sequence[Depth] | Depth, params: LocalizerParameters | None = None) -> Depth:
    """Learn the static background of each pixel from frames with the robot in several postures and no person.

    It is the median of the farthest readings that agree, at least two and a tenth of all frames. A pixel without a
    reading in half of the frames has its background at +inf: whatever appears there is in front of it.

    Parameters
    ----------
    frames : (k, height, width) float32 array, or sequence of images
        Depth (m); 0, NaN and +inf are no reading.
    """
    params = params or LocalizerParameters()
    stack = np.array(frames, dtype=np.float32)
    if stack.ndim != 3 or len(stack) == 0:
        raise StateError(f"frames: one or more images are needed, got shape {stack.shape}")
    stack[~((stack > 0.0) & np.isfinite(stack))] = np.nan
    count = len(stack)
    missing = np.isnan(stack).sum(axis=0)
    stack = -np.sort(-stack, axis=0)  # farthest first, no reading last
    needed = min(count, max(2, int(np.ceil(0.1 * count))))
    background = np.full(stack.shape[1:], np.inf, dtype=np.float32)
    open_ = missing < 0.5 * count
    for i in range(count):
        if not open_.any():
            break
        top = stack[i][open_]
        tolerance = 2.0 * params.background_margin * np.maximum((top / params.scale_depth) ** 2, params.least_scale)
        agree = stack[i:][:, open_] >= top - tolerance
        size = agree.sum(axis=0)
        median = np.take_along_axis(stack[i:][:, open_], np.maximum(size - 1, 0)[None] // 2, axis=0)[0]
        rows, cols = np.nonzero(open_)
        done = size >= needed
        background[rows[done], cols[done]] = median[done]
        open_[rows[done], cols[done]] = False
    return background


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
        best, owner, weak, strong = kernels.distances(
            depth, self.limit, self.x, self.y, shapes.kind, shapes.size, R_CS, p_CS, left, right, region,
            p.seed_distance, p.grow_distance, p.scale_depth, p.least_scale,
        )  # fmt: skip
        human = kernels.human_mask(
            depth, best, weak, strong, region, p.reach, p.support, p.support_step, p.scale_depth, p.least_scale,
            p.component,
        )  # fmt: skip
        seen = share_seen(depth, half, axis, R_CS, p_CS, *self.pinhole)
        points = kernels.human_points(depth, self.limit, self.x, self.y, best, human, region, p.reach, p.points_stride)
        points = points @ R_WC.T + p_WC
        nobody = Localization(-1, np.inf, np.zeros(3), np.zeros(3), seen, points)
        found: list[Localization] = []
        for _ in range(count):
            link, distance, p_C, extent = kernels.soft_minimum(
                depth, self.x, self.y, shapes.kind, shapes.size, shapes.link, R_CS, p_CS, best, owner, human, region,
                p.rank, p.softness, p.spread, int(p.rounds),
            )  # fmt: skip
            if link < 0 or distance > p.reach:
                break
            link, p_LC, n_L, width = self._touched(link, p_C, extent, R_WL, p_WL, R_WS, p_WS)
            found.append(Localization(link, distance, p_LC, n_L, seen, points, width))
            if distance > p.gate:
                break
            if len(found) < count:
                kernels.clear_near(depth, self.x, self.y, human, region, p_C, apart)
        return found or [nobody]

    def _touched(
        self, link: int, p_C: Array, extent: Array, R_WL: Array, p_WL: Array, R_WS: Array, p_WS: Array
    ) -> tuple[int, Array, Array, float]:
        """Return link, contact point, normal (link frame) and width of what touches for the surface point under it."""
        p, R_WC, p_WC = self.params, self._R_WC, self._p_WC
        p_LC, n_L = self.on_surface(link, R_WL[link].T @ (R_WC @ p_C + p_WC - p_WL[link]))
        R_LC = R_WL[link].T @ R_WC
        ray_L = R_LC @ (p_C / np.linalg.norm(p_C))
        across = R_LC.T @ (skew(n_L) @ ray_L)
        width = float(np.sqrt(max(across @ extent @ across, 0.0)) / max(np.linalg.norm(across), 1e-9))
        behind = min(max(p.thickness * width, p.least_thickness), p.most_thickness)
        p_W = p_WL[link] + R_WL[link] @ (p_LC + behind * (ray_L - (ray_L @ n_L) * n_L))
        shape, _, p_WC, n_W = nearest_surface_point(
            self.shapes.kind, self.shapes.size, R_WS, p_WS, self.shapes.link >= 0, p_W
        )
        link = int(self.shapes.link[shape])
        return link, R_WL[link].T @ (p_WC - p_WL[link]), R_WL[link].T @ n_W, width

    def on_surface(self, link: int, p_L: Array) -> tuple[Array, Array]:
        """Return the surface point of a link nearest to p_L and the outward normal there, all in the link's frame."""
        s = self.shapes
        _, _, p_LC, n_L = nearest_surface_point(s.kind, s.size, s.R_LS, s.p_LS, s.link == link, p_L)
        return p_LC, n_L
