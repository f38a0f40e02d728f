"""A fixed depth camera: its parameters and pose, the check that it can render, and how it enters a Diagram."""

import ctypes
import functools
import subprocess
import sys
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    ClippingRange,
    DepthRange,
    DepthRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.parameters import require_choice, require_positive
from saphari_drake.perception.raycasting_camera import RaycastingDepthCamera

RENDERER = "saphari_drake_depth"

# Renders one small depth image, as a process of its own: where Mesa's drivers are missing, VTK ends the process.
_PROBE = """
from pydrake.geometry import (ClippingRange, DepthRange, DepthRenderCamera, MakeRenderEngineVtk, RenderCameraCore,
                              RenderEngineVtkParams)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo, ImageDepth32F
core = RenderCameraCore("probe", CameraInfo(8, 8, 8.0, 8.0, 4.0, 4.0), ClippingRange(0.1, 5.0), RigidTransform())
engine = MakeRenderEngineVtk(RenderEngineVtkParams(backend="EGL"))
engine.RenderDepthImage(DepthRenderCamera(core, DepthRange(0.1, 4.0)), ImageDepth32F(8, 8))
"""


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
    # "vtk" (Drake's VTK engine over EGL), "raycast" (Open3D, needs no graphics driver), or "auto": VTK where it works.
    renderer: str = "auto"

    def __post_init__(self) -> None:
        require_positive(self, "width", "height", "focal_x", "focal_y", "near", "rate")
        require_choice(self, "renderer", ("auto", "vtk", "raycast"))
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


def _load_egl() -> None:
    """Load the EGL library; `OSError` if it does not exist."""
    ctypes.CDLL("libEGL.so.1")


def _run_probe() -> subprocess.CompletedProcess[str]:
    """Render one image in a new process and return how it ended."""
    return subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, text=True, timeout=60.0, check=False)


@functools.cache
def _renderer_problem() -> str:
    """Return why VTK cannot render off screen, or '' if it can; about 0.5 s once a process."""
    if sys.platform == "linux":
        try:
            _load_egl()
        except OSError:
            return "the EGL library is missing; install Debian's package 'libegl1' (and 'libgl1-mesa-dri')"
    try:
        ended = _run_probe()
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"the rendering probe did not finish ({error})"
    if ended.returncode == 0:
        return ""
    if ended.returncode < 0:
        return "no OpenGL driver can be loaded; install Debian's package 'libgl1-mesa-dri'"
    return f"the rendering probe failed: {ended.stderr.strip()[-300:]}"


def check_renderer() -> None:
    """Check that Drake's VTK engine can render without a display; the answer is found once a process.

    Raises
    ------
    SensorError
        If it cannot; the message names the missing Debian package. An engine made nevertheless may end the process.
    """
    problem = _renderer_problem()
    if problem:
        raise SensorError(f"cannot render depth images with VTK: {problem}, or set the camera's renderer to 'raycast'")


def _backend() -> str:
    """Return the window system that VTK draws with: EGL on Linux, where it needs no display."""
    return "EGL" if sys.platform == "linux" else ""


def add_depth_camera(
    builder: DiagramBuilder, scene_graph: SceneGraph, params: CameraParameters, name: str = "camera"
) -> LeafSystem | RgbdSensor:
    """Add a depth camera, connected to the SceneGraph, and return it.

    The camera sees geometry with the perception role. Its ports `depth_image_32f` (`ImageDepth32F`, m; 0 is too close
    and +inf too far or nothing) and `image_time` (s) have the same names with both engines, and it renders when
    `depth_image_32f` is evaluated. All geometry must be registered before this call.

    Parameters
    ----------
    builder : DiagramBuilder
        Diagram that `scene_graph` is part of.
    scene_graph : SceneGraph
        Source of the geometry.
    params : CameraParameters
    name : str
        Name of the new system.

    Raises
    ------
    SensorError
        If the chosen engine cannot be started; "auto" falls back to ray casting without VTK.
    """
    vtk = params.renderer == "vtk" or (params.renderer == "auto" and not _renderer_problem())
    X_WC = camera_pose(params)
    camera: LeafSystem | RgbdSensor
    if vtk:
        check_renderer()
        if not scene_graph.HasRenderer(RENDERER):
            scene_graph.AddRenderer(RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams(backend=_backend())))
        info = CameraInfo(params.width, params.height, params.focal_x, params.focal_y, *params.center)
        core = RenderCameraCore(RENDERER, info, ClippingRange(0.01, 2.0 * params.far), RigidTransform())
        depth = DepthRenderCamera(core, DepthRange(params.near, params.far))
        camera = RgbdSensor(scene_graph.world_frame_id(), X_WC, depth)
    else:
        x, y = ray_tables(params)
        camera = RaycastingDepthCamera(scene_graph.model_inspector(), X_WC, x, y, params.near, params.far)
    builder.AddNamedSystem(name, camera)
    builder.Connect(scene_graph.get_query_output_port(), camera.GetInputPort("geometry_query"))
    return camera
