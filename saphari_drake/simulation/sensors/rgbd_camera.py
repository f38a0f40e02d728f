"""A fixed depth camera: the check that it can render, and how it enters a Diagram."""

import ctypes
import functools
import subprocess
import sys

from pydrake.geometry import (
    ClippingRange,
    DepthRange,
    DepthRenderCamera,
    FrameId,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from saphari_drake.errors import SensorError
from saphari_drake.perception.camera.model import CameraParameters, camera_pose
from saphari_drake.simulation.sensors.raycasting_camera import RaycastingDepthCamera, meshes

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
    and +inf too far or nothing) and `image_time` (s) have the same names with all engines, and it renders when
    `depth_image_32f` is evaluated. All geometry must be registered before this call.

    The renderer "auto" is "raycast" where every shape that is seen is a sphere, ellipsoid, capsule, cylinder, box or
    half space. One mesh or convex hull, and the whole image is VTK's, but on a machine where VTK cannot start. The two
    differ by the triangles that VTK makes of round shapes, and at outlines by a pixel.

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
        If the chosen engine cannot be started, or cannot show a shape.
    """
    camera: LeafSystem | RgbdSensor
    if _chosen(scene_graph, params) == "vtk":
        camera = _vtk_camera(scene_graph, params)
    else:
        camera = RaycastingDepthCamera(scene_graph.model_inspector(), params, _anchored(builder))
    builder.AddNamedSystem(name, camera)
    builder.Connect(scene_graph.get_query_output_port(), camera.GetInputPort("geometry_query"))
    return camera


def _anchored(builder: DiagramBuilder) -> dict[FrameId, RigidTransform]:
    """Return the poses in the world of the bodies that are welded to it, by their geometry's frames."""
    poses = {}
    for plant in (system for system in builder.GetSystems() if isinstance(system, MultibodyPlant)):
        context = plant.CreateDefaultContext()
        for body in plant.GetBodiesWeldedTo(plant.world_body()):
            frame = plant.GetBodyFrameIdIfExists(body.index())
            if frame is not None:
                poses[frame] = plant.EvalBodyPoseInWorld(context, body)
    return poses


def _chosen(scene_graph: SceneGraph, params: CameraParameters) -> str:
    if params.renderer != "auto":
        return params.renderer
    return "vtk" if meshes(scene_graph.model_inspector()) and not _renderer_problem() else "raycast"


def _vtk_camera(scene_graph: SceneGraph, params: CameraParameters) -> RgbdSensor:
    check_renderer()
    if not scene_graph.HasRenderer(RENDERER):
        scene_graph.AddRenderer(RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams(backend=_backend())))
    info = CameraInfo(params.width, params.height, params.focal_x, params.focal_y, *params.center)
    core = RenderCameraCore(RENDERER, info, ClippingRange(0.01, 2.0 * params.far), RigidTransform())
    depth = DepthRenderCamera(core, DepthRange(params.near, params.far))
    return RgbdSensor(scene_graph.world_frame_id(), camera_pose(params), depth)
