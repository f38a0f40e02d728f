"""What a depth camera sees of a cell before anyone enters it."""

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.depth_noise import DepthNoiseParameters, add_kinect_noise
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera
from saphari_drake.simulation.world.floor import Floor

_GOLDEN = 0.6180339887498949


def scan_background(
    robot: RobotModel | None, floor: Floor, camera: CameraParameters, noise: DepthNoiseParameters, frames: int = 6
) -> NDArray[np.float32]:
    """Return noisy depth images (frames, height, width) in m of an empty cell, for `background_depth`.

    A robot is at home in the first of them, and in the others in postures that are spread over its joints' ranges.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    instance = None if robot is None else robot.add_to(plant)
    floor.add_to(plant)
    plant.Finalize()
    view = add_depth_camera(builder, scene_graph, camera)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    images = []
    for k in range(frames):
        if robot is not None:
            plant.SetPositions(plant.GetMyMutableContextFromRoot(context), instance, _posture(robot, k))
        exact = view.GetOutputPort("depth_image_32f").Eval(view.GetMyContextFromRoot(context)).data[..., 0].copy()
        images.append(add_kinect_noise(exact, np.random.default_rng([noise.seed, k]), noise, camera))
    return np.array(images)


def _posture(robot: RobotModel, k: int) -> NDArray[np.float64]:
    if k == 0:
        return robot.home
    low, high = np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi)
    return np.asarray(low + (0.1 + 0.8 * np.modf(k * _GOLDEN * np.arange(1, robot.n + 1))[0]) * (high - low))
