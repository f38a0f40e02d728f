# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # From zero to my robot
# A URDF, a Diagram with your own controller, and an observer that feels every push on it. Put the path of your own
# file where this one stands.

# %%
import matplotlib.pyplot as plt
import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ExternallyAppliedSpatialForce
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import InverseDynamicsController
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from saphari_drake import RobotDynamics, RobotModel
from saphari_drake.estimation import MomentumObserver
from saphari_drake.robots.catalog import models_dir
from saphari_drake.simulation.runner.graph import BlockDiagram
from saphari_drake.simulation.sensors.joint_sensor import JointSensor
from saphari_drake.systems import connect

# %% [markdown]
# ## What the library sees of a robot
# Joints, limits and home posture; its dynamics are evaluated by the library itself, and agree with Drake's.

# %%
robot = RobotModel(models_dir() / "lwr4" / "lwr4.urdf", home=np.deg2rad([0.0, -30.0, 0.0, 80.0, 0.0, 20.0, 0.0]))
print(robot)

# %% [markdown]
# ## Beside your controller
# Yours commands the torque; the observer is told what is applied and what the joints do. Someone pushes link 5 with
# 15 N.

# %%
builder = DiagramBuilder()
plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
arm = robot.add_to(plant)
plant.Finalize()
plant.SetDefaultPositions(arm, robot.home)
yours = builder.AddSystem(InverseDynamicsController(plant, [100] * robot.n, [0] * robot.n, [20] * robot.n, False))
target = builder.AddSystem(ConstantVectorSource([*robot.home, *[0] * robot.n]))
sensor, dynamics = builder.AddSystem(JointSensor(robot)), builder.AddSystem(RobotDynamics(robot))
observer = builder.AddSystem(MomentumObserver(robot))
push = ExternallyAppliedSpatialForce()
link = plant.GetBodyByName(robot.link_names[4])
push.body_index, push.F_Bq_W = link.index(), SpatialForce(np.zeros(3), np.array([0.0, 15.0, 0.0]))
pushing = builder.AddSystem(ConstantValueSource(AbstractValue.Make([push])))
builder.Connect(pushing.get_output_port(), plant.get_applied_spatial_force_input_port())
builder.Connect(plant.get_state_output_port(arm), yours.get_input_port_estimated_state())
builder.Connect(target.get_output_port(), yours.get_input_port_desired_state())
builder.Connect(yours.GetOutputPort("actuation"), plant.get_actuation_input_port(arm))
builder.Connect(plant.get_state_output_port(arm), sensor.get_input_port())
builder.Connect(yours.GetOutputPort("actuation"), observer.GetInputPort("torque_applied"))
connect(builder, (sensor, "position_measured", dynamics), (sensor, "velocity_measured", dynamics))
connect(builder, (dynamics, "dynamics", observer))
diagram = builder.Build()
BlockDiagram(diagram)

# %%
simulator, told = Simulator(diagram), []
context = observer.GetMyContextFromRoot(simulator.get_context())
for time in np.arange(0.01, 1.0, 0.01):
    simulator.AdvanceTo(time)
    told.append([time, *observer.GetOutputPort("torque_external").Eval(context)])
told = np.array(told)
plt.plot(told[:, 0], told[:, 1:])
plt.gca().set(xlabel="t [s]", ylabel="torque of the push [Nm]")

# %% [markdown]
# ## Is it right?
# At rest the residual is JᵀF, the Jacobian of the pushed point times the force; encoders are coarse, so its mean is
# taken.

# %%
q = plant.GetPositions(plant.GetMyContextFromRoot(simulator.get_context()), arm)
J = robot.kinematics(q).point(4, RigidTransform().translation()).Jv_WC
np.testing.assert_allclose(told[-50:, 1:].mean(axis=0), J.T @ [0.0, 15.0, 0.0], atol=0.05)
