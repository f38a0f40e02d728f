"""An arm whose tool stays while its third joint turns by 0.2 rad, within its limits (Section 4): MODEL [HOME, deg]."""

import sys

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake import load
from saphari_drake.control import ReversePriorityController
from saphari_drake.control.reverse_priority.system import home_references
from saphari_drake.control.reverse_priority.tasks import ScalarTask, joint_coordinate, joint_limits, position_task
from saphari_drake.pipelines import JointState, add_velocity_pipeline
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell

robot = load(sys.argv[1], home=np.deg2rad(np.array(sys.argv[2:], dtype=float)))
builder, tip, elbow = DiagramBuilder(), robot.link_names[-1], ScalarTask(joint_coordinate(robot, robot.joint_names[2]))
cell = add_cell(builder, robot)
controller = builder.AddSystem(
    ReversePriorityController(robot, [joint_limits(robot), position_task(robot, tip), elbow])
)
sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(period=0.001, differentiate=False)))
pipeline = add_velocity_pipeline(builder, robot, JointState(sensor.get_output_port(0), sensor.get_output_port(1)))
references = home_references(controller.stack)
references[1, 0] += 0.2
source = builder.AddSystem(ConstantVectorSource(references.ravel()))
builder.Connect(source.get_output_port(), controller.GetInputPort("references"))
builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
builder.Connect(sensor.GetOutputPort("position_measured"), controller.GetInputPort("position_measured"))
builder.Connect(controller.GetOutputPort("velocity_commanded"), pipeline.command_input)
builder.Connect(pipeline.torque_output, cell.torque_input)
(simulator := Simulator(builder.Build())).AdvanceTo(2.0)
q = cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(simulator.get_context()))[: robot.n]
moved = np.linalg.norm(robot.kinematics(q).p_WL[-1] - robot.kinematics(robot.home).p_WL[-1])
print(f"{robot.name}: joint 3 turned by {q[2] - robot.home[2]:.3f} rad, the tool moved by {1e3 * moved:.1f} mm")
