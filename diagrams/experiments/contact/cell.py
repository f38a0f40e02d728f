"""The cell of Section 7 as one diagram: robot, pushing hand, depth camera and the contact pipeline."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.segmentation.background import background_depth
from saphari_drake.pipelines.contact import ContactPipeline, ContactPipelineParameters, add_contact_pipeline
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.pushing_hand import HumanHand, Push
from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler, SamplerParameters, add_kinect_noise
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera
from saphari_drake.simulation.world.cell import Cell, CellParameters, add_cell
from saphari_drake.simulation.world.hand_and_floor import add_floor

Array = NDArray[np.float64]


@dataclass
class ContactCellParameters:
    """World, camera and pipeline."""

    cell: CellParameters = field(default_factory=CellParameters)
    camera: CameraParameters = field(default_factory=CameraParameters)
    sampler: SamplerParameters = field(default_factory=SamplerParameters)
    pipeline: ContactPipelineParameters = field(default_factory=ContactPipelineParameters)


@dataclass
class ContactCell:
    """The parts of the diagram that others look at."""

    cell: Cell
    hand: HumanHand
    camera: LeafSystem
    camera_parameters: CameraParameters
    sampler: DepthCameraSampler
    pipeline: ContactPipeline


def learn_background(robot: RobotModel, params: ContactCellParameters, frames: int = 6) -> NDArray[np.float32]:
    """Return the background depth image (m) from noisy frames of the robot in different postures, without a person."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    instance = robot.add_to(plant)
    add_floor(plant)
    plant.Finalize()
    camera = add_depth_camera(builder, scene_graph, params.camera)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    low, high = np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi)
    images = []
    for k in range(frames):
        q = (
            robot.home
            if k == 0
            else low + (0.1 + 0.8 * np.modf(k * _GOLDEN * np.arange(1, robot.n + 1))[0]) * (high - low)
        )
        plant.SetPositions(plant.GetMyMutableContextFromRoot(context), instance, q)
        image = camera.GetOutputPort("depth_image_32f").Eval(camera.GetMyContextFromRoot(context))
        rng = np.random.default_rng([params.sampler.noise.seed, k])
        images.append(add_kinect_noise(image.data[..., 0].copy(), rng, params.sampler.noise, params.camera))
    return background_depth(images, params.pipeline.localizer)


_GOLDEN = 0.6180339887498949


def add_contact_cell(
    builder: DiagramBuilder,
    robot: RobotModel,
    pushes: Sequence[Push],
    params: ContactCellParameters | None = None,
    force_profile: Callable[[float], Array | None] | None = None,
) -> ContactCell:
    """Add the whole cell; the robot starts at its home posture, the hand before its first target."""
    params = params or ContactCellParameters()
    cell = add_cell(builder, robot, params.cell)
    # The force control has no stiffness; recordings are not played to it.
    K_p = getattr(params.pipeline.controller, "K_p", np.inf)
    hand = builder.AddNamedSystem(
        "human_hand",
        HumanHand(
            robot,
            params.cell.hand,
            pushes,
            cell.plant.num_velocities(),
            cell.hand.floating_velocities_start_in_v(),
            force_profile,
            float(np.mean(K_p)),
        ),
    )
    cell.plant.SetDefaultFloatingBaseBodyPose(cell.hand, hand.start_pose())
    builder.Connect(cell.hand_state, hand.GetInputPort("hand_state"))
    builder.Connect(cell.robot_state, hand.GetInputPort("robot_state"))
    builder.Connect(hand.GetOutputPort("generalized_force"), cell.hand_force_input)
    camera = add_depth_camera(builder, cell.scene_graph, params.camera)
    sampler = builder.AddNamedSystem("camera_sampler", DepthCameraSampler(params.camera, params.sampler))
    builder.Connect(camera.GetOutputPort("depth_image_32f"), sampler.GetInputPort("depth_image"))
    background = learn_background(robot, params)
    pipeline = add_contact_pipeline(builder, robot, params.camera, params.pipeline, background)
    builder.Connect(cell.robot_state, pipeline.state_input)
    builder.Connect(sampler.GetOutputPort("depth_image"), pipeline.depth_input)
    builder.Connect(sampler.GetOutputPort("image_time"), pipeline.image_time_input)
    builder.Connect(pipeline.torque_output, cell.torque_input)
    return ContactCell(cell, hand, camera, params.camera, sampler, pipeline)
