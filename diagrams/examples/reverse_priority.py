"""An arm whose tool stays while its third joint turns by 0.2 rad, within its limits (Section 4): MODEL [HOME, deg]."""

import sys

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake import RobotDynamics, load
from saphari_drake.control import JointVelocityServo, ReversePriorityController
from saphari_drake.control.reverse_priority.system import home_references
from saphari_drake.control.reverse_priority.tasks import ScalarTask, joint_coordinate, joint_limits, position_task
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.systems import connect

robot = load(sys.argv[1], home=np.deg2rad(np.array(sys.argv[2:], dtype=float)))
builder, tip, elbow = DiagramBuilder(), robot.link_names[-1], ScalarTask(joint_coordinate(robot, robot.joint_names[2]))
cell = add_cell(builder, robot)
controller = builder.AddSystem(
    ReversePriorityController(robot, [joint_limits(robot), position_task(robot, tip), elbow])
)
servo, dynamics = builder.AddSystem(JointVelocityServo(robot)), builder.AddSystem(RobotDynamics(robot))
sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(period=0.002)))
references = home_references(controller.stack)
references[1, 0] += 0.2
source = builder.AddSystem(ConstantVectorSource(references.ravel()))
builder.Connect(source.get_output_port(), controller.GetInputPort("references"))
builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
connect(builder, (sensor, "position_measured", controller, dynamics), (sensor, "velocity_measured", dynamics))
connect(builder, (controller, "velocity_commanded", servo), (dynamics, "dynamics", servo))
builder.Connect(servo.GetOutputPort("torque_commanded"), cell.torque_input)
(simulator := Simulator(builder.Build())).AdvanceTo(2.0)
q = cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(simulator.get_context()))[: robot.n]
moved = np.linalg.norm(robot.kinematics(q).p_WL[-1] - robot.kinematics(robot.home).p_WL[-1])
print(f"{robot.name}: joint 3 turned by {q[2] - robot.home[2]:.3f} rad, the tool moved by {1e3 * moved:.1f} mm")
