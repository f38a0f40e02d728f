"""An arm that gives way in its null space and keeps its tool where it is (Section 5): MODEL [HOME, deg a joint]."""

import sys

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake import load
from saphari_drake.pipelines import add_null_space_pipeline
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell

robot = load(sys.argv[1], home=np.deg2rad(np.array(sys.argv[2:], dtype=float)))
builder = DiagramBuilder()
cell = add_cell(builder, robot)
sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(period=0.002)))
builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
position, velocity = (sensor.GetOutputPort(f"{name}_measured") for name in ("position", "velocity"))
pipeline = add_null_space_pipeline(builder, robot, position, velocity)
builder.Connect(pipeline.torque_output, cell.torque_input)
simulator = Simulator(builder.Build())
simulator.AdvanceTo(0.2)
context = pipeline.controller.GetMyContextFromRoot(simulator.get_context())
error = pipeline.controller.GetOutputPort("task_error").Eval(context)
print(f"{robot.name}: the end effector is {1e3 * np.linalg.norm(error):.3f} mm from where it is to stay")
