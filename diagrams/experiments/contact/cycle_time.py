"""Wall time of one estimation and control cycle, rendering apart."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import PassThrough
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.pipelines.contact import ContactMeasurements, ContactPipelineParameters, add_contact_pipeline
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters

Array = NDArray[np.float64]


def time_cycles(
    robot: RobotModel,
    camera: CameraParameters,
    params: ContactPipelineParameters,
    states: Array,
    depth: NDArray[np.float32],
    background: NDArray[np.float32] | None = None,
    warm_up: int = 40,
) -> tuple[Array, NDArray[np.bool_]]:
    """Play joint states into the pipeline, with a new frame at the camera's rate, and time every cycle.

    Parameters
    ----------
    states : (T, 2n) array
        Joint states, one a cycle.
    depth : (height, width) array
        The image of every frame (m).

    Returns
    -------
    seconds (T − warm_up,), with_frame (T − warm_up,)
        Wall time of each cycle, and whether it had a new frame to localize.
    """
    builder = DiagramBuilder()
    period, last = params.period, -np.inf
    joints = builder.AddSystem(JointSensor(robot, JointSensorParameters(period)))
    frames = builder.AddSystem(PassThrough(Value[ImageDepth32F](ImageDepth32F(camera.width, camera.height))))
    times = builder.AddSystem(PassThrough(1))
    ports = joints.get_output_port(0), joints.get_output_port(1), frames.get_output_port(), times.get_output_port()
    pipeline = add_contact_pipeline(builder, robot, ContactMeasurements(*ports), camera, params, background)
    state, image, stamp = (builder.ExportInput(system.get_input_port()) for system in (joints, frames, times))
    builder.ExportOutput(pipeline.torque_output, "torque")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    frame = ImageDepth32F(camera.width, camera.height)
    frame.mutable_data[..., 0] = depth
    diagram.get_input_port(image).FixValue(context, Value[ImageDepth32F](frame))
    diagram.get_input_port(state).FixValue(context, states[0])
    diagram.get_input_port(stamp).FixValue(context, [-1.0])
    torque = diagram.get_output_port(0)
    simulator.Initialize()
    seconds, with_frame = np.zeros(len(states)), np.zeros(len(states), dtype=bool)
    for k, sample in enumerate(states):
        now = k * period
        diagram.get_input_port(state).FixValue(context, sample)
        with_frame[k] = now - last >= 1.0 / camera.rate - 1e-9
        if with_frame[k]:
            last = now
            diagram.get_input_port(stamp).FixValue(context, [now])
        start = time.perf_counter()
        # Past the cycle's events, which fire just after the nominal time.
        simulator.AdvanceTo(now + 0.5 * period)
        torque.Eval(context)
        seconds[k] = time.perf_counter() - start
    return seconds[warm_up:], with_frame[warm_up:]
