"""An arm that a hand at its tool leads by 5 N upwards, without a skin (Section 6): MODEL [HOME, deg a joint]."""

import sys

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake import load
from saphari_drake.perception import WristWrenchParameters
from saphari_drake.pipelines import HandGuidingMeasurements, HandGuidingPipelineParameters, add_hand_guiding_pipeline
from saphari_drake.simulation.people.guiding_hands import Grip, GuidingHands, Hand, Pull
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensor, ForceTorqueSensorParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell

robot = load(sys.argv[1], home=np.deg2rad(np.array(sys.argv[2:], dtype=float)))
builder, wrist = DiagramBuilder(), WristWrenchParameters(robot.joint_names[-1], robot.link_names[-1])
cell = add_cell(builder, robot)
sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(period=0.002)))
load_cell = builder.AddSystem(ForceTorqueSensor(cell.plant, cell.instance, ForceTorqueSensorParameters(wrist.joint)))
hand = Grip(robot.n - 1, np.zeros(3), Hand([Pull(0.3, 1.0, 0.1, [0.0, 0.0, 5.0])]))
hands = builder.AddSystem(GuidingHands(robot, cell.plant, cell.instance, [hand]))
builder.Connect(cell.robot_state, hands.GetInputPort("state"))
builder.Connect(hands.GetOutputPort("applied_forces"), cell.plant.get_applied_spatial_force_input_port())
builder.Connect(cell.plant.get_reaction_forces_output_port(), load_cell.GetInputPort("reaction_forces"))
builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
position, velocity = (sensor.GetOutputPort(f"{name}_measured") for name in ("position", "velocity"))
measured = HandGuidingMeasurements(position, velocity, load_cell.GetOutputPort("wrench_sensor"))
pipeline = add_hand_guiding_pipeline(builder, robot, measured, params=HandGuidingPipelineParameters(wrist=wrist))
builder.Connect(pipeline.torque_output, cell.torque_input)
(simulator := Simulator(builder.Build())).AdvanceTo(1.3)
q = cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(simulator.get_context()))[: robot.n]
print(
    f"{robot.name}: led up by {1e3 * (robot.kinematics(q).p_WL[-1] - robot.kinematics(robot.home).p_WL[-1])[2]:.1f} mm"
)
