"""A fixed pinhole camera: its parameters, its pose, and the rays through its pixels."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_choice, require_positive, require_within


@dataclass
class CameraParameters:
    """A pinhole depth camera fixed in the world, by default like the first Kinect.

    Pixel (column i, row j) looks along ((i + 0.5 − center_x) / focal_x, (j + 0.5 − center_y) / focal_y, 1) in the
    camera frame (x right, y down, z forward): pixel coordinates count from the edge of the image.
    """

    # Image size (pixels, > 0). Kinect v1.
    width: int = 640
    height: int = 480
    # Focal lengths (pixels, > 0). Published calibrations of the Kinect v1's infrared camera lie at 570–590.
    focal_x: float = 575.0
    focal_y: float = 575.0
    # Principal point (pixels from the left and top edge, inside the image); NaN stands for the centre of the image.
    center_x: float = np.nan
    center_y: float = np.nan
    # Range of depths that are measured (m, 0 < near < far). Kinect v1.
    near: float = 0.4
    far: float = 4.5
    # Frame rate (Hz, > 0). Kinect v1.
    rate: float = 30.0
    # Position of the optical centre in the world (m). Chosen to see a table-top arm at the origin from the front.
    position: list[float] = field(default_factory=lambda: [-1.7, 0.0, 1.1])
    # Point in the world that the optical axis goes through (m), not above or below the camera.
    target: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.55])
    # "raycast" (exact rays at primitives, ten times as fast as VTK; Open3D's at meshes; needs no driver), "vtk"
    # (Drake's VTK engine over EGL), or "auto": "raycast" unless there are meshes and VTK works.
    renderer: str = "auto"

    def __post_init__(self) -> None:
        require_positive(self, "focal_x", "focal_y", "near")
        require_within(self, 1, 8192, "width", "height")
        require_within(self, 1e-3, 1000.0, "rate")
        require_choice(self, "renderer", ("auto", "raycast", "vtk"))
        if not self.near < self.far < np.inf:
            raise ParameterError("far", f"must be finite and above near ({self.near} m), got {self.far}")
        for name in ("position", "target"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (3,) or not np.all(np.isfinite(value)):
                raise ParameterError(name, f"needs 3 finite coordinates, got {getattr(self, name)}")
        if np.linalg.norm(np.subtract(self.target, self.position)[:2]) < 1e-6:
            raise ParameterError("target", "must not lie straight above or below the camera")
        for name, size in (("center_x", self.width), ("center_y", self.height)):
            value = getattr(self, name)
            if not (np.isnan(value) or 0.0 <= value <= size):
                raise ParameterError(name, f"must lie in the image, 0 to {size}, got {value}")

    @property
    def center(self) -> tuple[float, float]:
        """Principal point (pixels from the left and top edge)."""
        x, y = self.center_x, self.center_y
        return (self.width / 2 if np.isnan(x) else x), (self.height / 2 if np.isnan(y) else y)


class Pinhole(NamedTuple):
    """Optics of a camera, for compiled passes."""

    fx: float  # focal lengths and principal point, pixels
    fy: float
    cx: float
    cy: float
    x: NDArray[np.float32]  # (width,) x/z through the centre of each column
    y: NDArray[np.float32]  # (height,) y/z through the centre of each row


def pinhole(params: CameraParameters) -> Pinhole:
    """Return the optics of a camera."""
    return Pinhole(params.focal_x, params.focal_y, *params.center, *ray_tables(params))


def camera_pose(params: CameraParameters) -> RigidTransform:
    """Return X_WC, with z of the camera frame C forward, x right and y down in the image."""
    position = np.asarray(params.position, dtype=float)
    forward = np.asarray(params.target, dtype=float) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return RigidTransform(RotationMatrix(np.column_stack([right, np.cross(forward, right), forward])), position)


def ray_tables(params: CameraParameters) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return x/z of each column (width,) and y/z of each row (height,) of the image, through pixel centres."""
    center_x, center_y = params.center
    x = (np.arange(params.width) + 0.5 - center_x) / params.focal_x
    y = (np.arange(params.height) + 0.5 - center_y) / params.focal_y
    return x.astype(np.float32), y.astype(np.float32)


def back_projected(x: NDArray, y: NDArray, z: NDArray) -> NDArray:
    """Return the points (height, width, 3) of a depth image z (m) in the camera frame; x and y as in `ray_tables`."""
    return np.stack([x * z, y[:, None] * z, z], axis=-1)
