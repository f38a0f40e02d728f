"""An arm that goes 5 cm sideways, clear of a point in its way, by predictive control (Section 3): MODEL [HOME, deg]."""

import sys

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from saphari_drake import load
from saphari_drake.control import NmpcController
from saphari_drake.control.nmpc.parameters import NmpcReference, TestPoint
from saphari_drake.messages import ObstaclePoints
from saphari_drake.pipelines import JointState, add_velocity_pipeline
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell

robot = load(sys.argv[1], home=np.deg2rad(np.array(sys.argv[2:], dtype=float)))
builder, at, tip = DiagramBuilder(), robot.kinematics(robot.home), robot.link_names[-1]
cell = add_cell(builder, robot)
goal = NmpcReference(at.p_WL[-1:] + np.array([0.0, 0.05, 0.0]), at.R_WL[-1:])
point = ObstaclePoints(at.p_WL[-1:] + np.array([0.0, 0.4, 0.0]), np.zeros((1, 3)), np.zeros(1))
controller = builder.AddSystem(NmpcController(robot, tip, [TestPoint("tip", tip, d_min=0.1)]))
sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(period=0.001, differentiate=False)))
pipeline = add_velocity_pipeline(builder, robot, JointState(sensor.get_output_port(0), sensor.get_output_port(1)))
for name, value in (("reference", goal), ("obstacles", point)):
    source = builder.AddSystem(ConstantValueSource(AbstractValue.Make(value)))
    builder.Connect(source.get_output_port(), controller.GetInputPort(name))
builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
builder.Connect(sensor.GetOutputPort("position_measured"), controller.GetInputPort("position_measured"))
builder.Connect(controller.GetOutputPort("velocity_commanded"), pipeline.command_input)
builder.Connect(pipeline.torque_output, cell.torque_input)
simulator = Simulator(builder.Build())
simulator.AdvanceTo(2.0)
state = cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(simulator.get_context()))
error = np.linalg.norm(robot.kinematics(state[: robot.n]).p_WL[-1] - goal.p_WE[0])
print(f"{robot.name}: {1e3 * error:.1f} mm from the goal")
