"""A pipeline in a loop with a simulated arm, whose measured values can be spoiled one port at a time."""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, PassThrough
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.pipelines.contact import ContactMeasurements, ContactPipelineParameters, add_contact_pipeline
from saphari_drake.pipelines.null_space import NullSpacePipelineParameters, add_null_space_pipeline
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters


class MeasuredLoop:
    """An arm at rest under a pipeline; `spoil` adds to what is measured, and a push is a joint torque from outside."""

    def __init__(self, robot, period, add_pipeline):
        self.robot, self.builder, n = robot, DiagramBuilder(), robot.n
        self.plant = MultibodyPlant(0.001)
        instance = robot.add_to(self.plant)
        self.plant.Finalize()
        self.plant.SetDefaultPositions(instance, robot.home)
        self.builder.AddSystem(self.plant)
        sensor = self.builder.AddSystem(JointSensor(robot, JointSensorParameters(period, 1e-6)))
        self.state = self.plant.get_state_output_port(instance)
        self.builder.Connect(self.state, sensor.get_input_port())
        self.zeros, measured = {}, []
        for k, name in enumerate(("position_measured", "velocity_measured")):
            spoiled = self.builder.AddSystem(Adder(2, n))
            self.builder.Connect(sensor.get_output_port(k), spoiled.get_input_port(0))
            self._export(spoiled.get_input_port(1), name, np.zeros(n))
            measured.append(spoiled.get_output_port())
        self._export(self.plant.get_applied_generalized_force_input_port(), "push", np.zeros(n))
        self.pipeline = add_pipeline(self, *measured)
        self.builder.Connect(self.pipeline.torque_output, self.plant.get_actuation_input_port(instance))
        self.diagram = self.builder.Build()
        self.restart()

    def _export(self, port, name, value):
        self.builder.ExportInput(port, name)
        self.zeros[name] = value

    def source(self, name, value):
        """Return the port of a source whose value is set by name."""
        system = PassThrough(len(value)) if isinstance(value, np.ndarray) else PassThrough(value)
        self.builder.AddSystem(system)
        self._export(system.get_input_port(), name, value)
        return system.get_output_port()

    def restart(self):
        """Go back to the start, at rest, with nothing spoiled."""
        self.simulator = Simulator(self.diagram)
        self.context, self.steps = self.simulator.get_mutable_context(), 0
        self.spoil(**self.zeros)
        self.simulator.Initialize()

    def spoil(self, **values):
        for name, value in values.items():
            self.diagram.GetInputPort(name).FixValue(self.context, value)

    def read(self, system, name):
        return np.array(system.GetOutputPort(name).Eval(system.GetMyContextFromRoot(self.context)))

    @property
    def wrist(self):
        """Position of a point at the flange from the plant's own state (m)."""
        q = self.state.Eval(self.plant.GetMyContextFromRoot(self.context))[: self.robot.n]
        terms = evaluate_dynamics(self.robot, q, np.zeros(self.robot.n))
        return terms.point(self.robot.n - 1, np.array([0.0, 0.0, 0.1])).p_WC

    def run(self, steps, each=lambda loop: None):
        """Go on by milliseconds; return the applied torques (steps, n) and the switch's status (steps,)."""
        torques, statuses = [], []
        for _ in range(steps):
            each(self)
            self.steps += 1
            self.simulator.AdvanceTo(0.001 * self.steps + 2e-6)
            torques.append(self.read(self.pipeline.envelope, "torque_applied"))
            statuses.append(self.read(self.pipeline.switch, "system_status")[0])
        return np.array(torques), np.array(statuses)


def null_space_loop(robot, **controller):
    """Return the loop of the null-space pipeline, with a desired motion."""
    params = NullSpacePipelineParameters()
    for name, value in controller.items():
        setattr(params.controller, name, value)

    def add(loop, position, velocity):
        pipeline = add_null_space_pipeline(loop.builder, robot, position, velocity, params)
        home = pipeline.controller.kinematics(evaluate_dynamics(robot, robot.home, np.zeros(robot.n)))
        for name, value in (
            ("desired_pose", AbstractValue.Make(RigidTransform(RotationMatrix(home.R), home.p))),
            ("desired_velocity", np.zeros(6)),
            ("desired_acceleration", np.zeros(6)),
            ("nominal_posture", robot.home),
        ):
            loop._export(pipeline.controller.GetInputPort(name), name, value)
        return pipeline

    return MeasuredLoop(robot, params.period, add)


def contact_loop(robot, params=None):
    """Return the loop of the contact pipeline, whose camera sees nothing near; `see` gives it a new frame."""
    params, camera = params or ContactPipelineParameters(), CameraParameters()
    far = ImageDepth32F(camera.width, camera.height)
    far.mutable_data[..., 0] = 3.0

    def add(loop, position, velocity):
        image = loop.source("depth_image", Value[ImageDepth32F](far))
        time = loop.source("image_time", np.array([-1.0]))
        measured = ContactMeasurements(position, velocity, image, time)
        return add_contact_pipeline(loop.builder, robot, measured, camera, params)

    return MeasuredLoop(robot, params.period, add)


def see(loop):
    """Give the camera a frame every 30 ms."""
    if loop.steps % 30 == 0:
        loop.spoil(image_time=np.array([0.001 * loop.steps]))
