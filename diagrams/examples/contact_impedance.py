"""An arm that feels, sees and answers a touch (Section 7); here nobody comes: MODEL [HOME, deg a joint]."""

import sys

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake import load
from saphari_drake.messages import InteractionMode
from saphari_drake.perception import CameraParameters
from saphari_drake.pipelines import ContactMeasurements, add_contact_pipeline
from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler
from saphari_drake.simulation.sensors.joint_sensor import JointSensor
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera
from saphari_drake.simulation.world.cell import add_cell

robot = load(sys.argv[1], home=np.deg2rad(np.array(sys.argv[2:], dtype=float)))
builder, camera = DiagramBuilder(), CameraParameters(renderer="raycast")
cell = add_cell(builder, robot)
sensor, sampler = builder.AddSystem(JointSensor(robot)), builder.AddSystem(DepthCameraSampler(camera))
image = add_depth_camera(builder, cell.scene_graph, camera).GetOutputPort("depth_image_32f")
builder.Connect(image, sampler.GetInputPort("depth_image"))
builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
position, velocity = (sensor.GetOutputPort(f"{name}_measured") for name in ("position", "velocity"))
frames = (sampler.GetOutputPort(name) for name in ("depth_image", "image_time"))
pipeline = add_contact_pipeline(builder, robot, ContactMeasurements(position, velocity, *frames), camera)
builder.Connect(pipeline.torque_output, cell.torque_input)
simulator = Simulator(builder.Build())
simulator.AdvanceTo(0.2)
mode = pipeline.monitor.GetOutputPort("mode").Eval(pipeline.monitor.GetMyContextFromRoot(simulator.get_context()))
print(f"{robot.name}: {InteractionMode(int(mode[0])).name}")
