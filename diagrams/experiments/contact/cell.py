"""The cell of Section 7 as one diagram: robot, pushing hand, depth camera and the contact pipeline."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from experiments.contact.known import adapt_to_encoders, adapt_to_friction
from experiments.joint_state import feel_torque, joint_witness, own_joint_state
from saphari_drake.parameters import share_period
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.segmentation.background import background_depth
from saphari_drake.pipelines.contact import (
    ContactMeasurements,
    ContactPipeline,
    ContactPipelineParameters,
    add_contact_pipeline,
)
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.cameras import inject_into_camera
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.sensors.background_scan import scan_background
from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler, SamplerParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera
from saphari_drake.simulation.world.cell import Cell, add_cell
from saphari_drake.simulation.world.floor import Floor
from saphari_drake.simulation.world.hand import HandParameters
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.simulation.world.profile import Truth
from saphari_drake.simulation.world.pushing_hand import PushingHand

Array = NDArray[np.float64]


@dataclass
class CellParameters(PlantParameters):
    """The simulated world."""

    # The person's hand.
    hand: HandParameters = field(default_factory=HandParameters)


@dataclass
class ContactCellParameters:
    """World, sensors and pipeline."""

    joint_sensor: JointSensorParameters = field(default_factory=JointSensorParameters)
    cell: CellParameters = field(default_factory=CellParameters)
    camera: CameraParameters = field(default_factory=CameraParameters)
    sampler: SamplerParameters = field(default_factory=SamplerParameters)
    pipeline: ContactPipelineParameters = field(default_factory=ContactPipelineParameters)

    def __post_init__(self) -> None:
        share_period(self, "joint_sensor")

    @property
    def period(self) -> float:
        """The control cycle (s)."""
        return self.pipeline.period


@dataclass
class ContactCell:
    """The parts of the diagram that others look at."""

    cell: Cell
    camera: LeafSystem
    camera_parameters: CameraParameters
    sampler: DepthCameraSampler
    pipeline: ContactPipeline


def learn_background(robot: RobotModel, params: ContactCellParameters, frames: int = 6) -> NDArray[np.float32]:
    """Return the background depth image (m) from noisy frames of the robot in different postures, without a person."""
    images = scan_background(robot, Floor(), params.camera, params.sampler.noise, frames)
    return background_depth(images, params.pipeline.localizer)


def add_contact_cell(
    builder: DiagramBuilder,
    robot: RobotModel,
    pushes: Sequence[Push],
    params: ContactCellParameters | None = None,
    force_profile: Callable[[float], Array | None] | None = None,
    truth: Truth | None = None,
) -> ContactCell:
    """Add the whole cell; the robot starts at its home posture, the hand before its first target."""
    params, truth = params or ContactCellParameters(), truth or Truth()
    # The force control has no stiffness; recordings are not played to it.
    stiffness = float(np.mean(getattr(params.pipeline.controller, "K_p", np.inf)))
    hand = PushingHand(pushes, params.cell.hand, force_profile, stiffness)
    cell = add_cell(builder, robot, [hand, Floor()], params.cell, truth)
    camera = add_depth_camera(builder, cell.scene_graph, params.camera)
    sampler = builder.AddNamedSystem("camera_sampler", DepthCameraSampler(params.camera, truth.sampler(params.sampler)))
    builder.Connect(camera.GetOutputPort("depth_image_32f"), sampler.GetInputPort("depth_image"))
    background = learn_background(robot, params)
    params.__post_init__()
    params.pipeline.localizer.frozen_frames = 2 if params.sampler.noise.enabled else 0
    encoders = truth.joint_sensor(params.joint_sensor)
    adapt_to_encoders(params.pipeline, robot, encoders)
    adapt_to_friction(params.pipeline, encoders)
    joints = builder.AddNamedSystem("joint_sensor", JointSensor(robot, encoders))
    builder.Connect(cell.robot_state, joints.GetInputPort("state"))
    ports = ("position_measured", "velocity_measured"), ("depth_image", "image_time")
    position, velocity, image, time = (
        system.GetOutputPort(name) for system, names in zip((joints, sampler), ports) for name in names
    )
    state = own_joint_state(
        builder, robot, cell, params.joint_sensor, params.pipeline.envelope, params.pipeline.observer, truth
    )
    witness = joint_witness(builder, robot, cell, params.joint_sensor, truth)
    measured = ContactMeasurements(position, velocity, image, time, state, witness)
    pipeline = add_contact_pipeline(builder, robot, measured, params.camera, params.pipeline, background)
    builder.Connect(pipeline.torque_output, cell.torque_input)
    feel_torque(builder, cell, pipeline.torque_output)
    inject_into_camera(builder, cell.scene_graph, params.camera, sampler, params.sampler, truth)
    return ContactCell(cell, camera, params.camera, sampler, pipeline)
