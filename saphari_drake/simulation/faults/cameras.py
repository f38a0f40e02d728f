"""Brings the faults of a camera into a diagram."""

from dataclasses import replace

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.simulation.faults.frames import CameraMoves, FrameFault, blind, noisier
from saphari_drake.simulation.faults.registry import FAULTS
from saphari_drake.simulation.faults.wiring import insert, readers, source_of
from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler, SamplerParameters
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera
from saphari_drake.simulation.world.profile import Truth


def inject_into_camera(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    camera: CameraParameters,
    sampler: DepthCameraSampler,
    noise: SamplerParameters,
    truth: Truth,
) -> None:
    """Insert the camera faults of `truth` before and behind a wired sampler; without them it does nothing."""
    for name, start in truth.faults.items():
        if FAULTS[name].part != "camera":
            continue
        if name == "camera_moved":
            _move(builder, scene_graph, camera, sampler, truth, start)
            continue
        fault = builder.AddNamedSystem(name, _frames(name, camera, noise, truth, start))
        for port in ("depth_image", "image_time"):
            source = sampler.GetOutputPort(port)
            for target in readers(builder, source):
                if target.get_system() is not fault:
                    insert(builder, source, target, fault, (port, port))


def _frames(name: str, camera: CameraParameters, noise: SamplerParameters, truth: Truth, start: float) -> FrameFault:
    size, sizes = (camera.width, camera.height), truth.sizes
    if name == "camera_dropout":
        return FrameFault(*size, start, delay=np.inf)
    if name == "camera_delay":
        return FrameFault(*size, start, delay=sizes.camera_delay)
    if name == "camera_freeze":
        return FrameFault(*size, start, lambda image, shown, number: shown)
    if name == "camera_blind":
        return FrameFault(*size, start, blind(sizes.blind_share))
    return FrameFault(*size, start, noisier(noise.noise.sigma, noise.noise.sigma_depth, truth.seed))


def _move(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    camera: CameraParameters,
    sampler: LeafSystem,
    truth: Truth,
    start: float,
) -> None:
    aside = np.random.default_rng([truth.seed, 14]).normal(size=3)
    aside *= truth.sizes.camera_shift / np.linalg.norm(aside)
    there = replace(
        camera, position=(np.array(camera.position) + aside).tolist(), target=(np.array(camera.target) + aside).tolist()
    )
    moved = add_depth_camera(builder, scene_graph, there, "camera_after_move")
    moves = builder.AddNamedSystem("camera_moved", CameraMoves(camera.width, camera.height, start))
    target = sampler.GetInputPort("depth_image")
    builder.Connect(moved.GetOutputPort("depth_image_32f"), moves.GetInputPort("after"))
    insert(builder, source_of(builder, target), target, moves, ("before", "depth_image"))
