"""A ceiling camera that tells the predictive controller where people are."""

from dataclasses import dataclass, field

from pydrake.geometry import SceneGraph
from pydrake.systems.framework import DiagramBuilder, OutputPort

from experiments.nmpc.jobs import NmpcJob
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.obstacles.tracker import ObstacleTracker
from saphari_drake.perception.obstacles.tracks import ObstacleTrackerParameters
from saphari_drake.perception.segmentation.background import background_depth
from saphari_drake.perception.segmentation.parameters import SegmentationParameters
from saphari_drake.simulation.faults.cameras import inject_into_camera
from saphari_drake.simulation.sensors.background_scan import scan_background
from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler, SamplerParameters
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.profile import Truth

FLOOR = 16.0  # m; edge of the floor


def _ceiling_camera() -> CameraParameters:
    return CameraParameters(
        width=320, height=240, focal_x=287.5, focal_y=287.5, rate=15.0, position=[1.1, 3.0, 2.9], target=[0.2, 3.0, 1.1]
    )


@dataclass
class ObstacleWatch:
    """The camera, and what makes obstacle points of its images."""

    # Above and behind a person who stands beside the path of Fig. 2. A Kinect at half resolution and rate. Assumed.
    camera: CameraParameters = field(default_factory=_ceiling_camera)
    sampler: SamplerParameters = field(default_factory=SamplerParameters)
    vision: SegmentationParameters = field(default_factory=SegmentationParameters)
    tracker: ObstacleTrackerParameters = field(default_factory=ObstacleTrackerParameters)


def add_obstacle_watch(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    job: NmpcJob,
    params: ObstacleWatch,
    position: OutputPort,
    truth: Truth,
) -> OutputPort:
    """Add camera, sampler and tracker to a diagram whose geometry is complete; return the obstacle points they see."""
    camera = add_depth_camera(builder, scene_graph, params.camera)
    sampler = builder.AddNamedSystem("camera_sampler", DepthCameraSampler(params.camera, truth.sampler(params.sampler)))
    # Learnt before the robot and a person are there.
    background = background_depth(
        scan_background(None, Floor(FLOOR), params.camera, params.sampler.noise), params.vision
    )
    tracker = builder.AddNamedSystem(
        "obstacle_tracker", ObstacleTracker(job.robot, params.camera, params.tracker, params.vision, background)
    )
    builder.Connect(camera.GetOutputPort("depth_image_32f"), sampler.GetInputPort("depth_image"))
    builder.Connect(sampler.GetOutputPort("depth_image"), tracker.GetInputPort("depth_image"))
    builder.Connect(sampler.GetOutputPort("image_time"), tracker.GetInputPort("image_time"))
    builder.Connect(position, tracker.GetInputPort("position_measured"))
    inject_into_camera(builder, scene_graph, params.camera, sampler, params.sampler, truth)
    return tracker.GetOutputPort("obstacles")
