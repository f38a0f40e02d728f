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
# # The elbow gives way, the hand stays
# A ball pushes the arm's elbow. Without an observer the end effector is pushed off by K⁻¹ J_M^{#T} τ_ext; with one,
# what the ball does to the task is known, and taken back.

# %%
import matplotlib.pyplot as plt
import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake import lwr4
from saphari_drake.control import NullSpaceComplianceParameters
from saphari_drake.pipelines import NullSpacePipelineParameters, add_null_space_pipeline
from saphari_drake.simulation.runner.graph import BlockDiagram
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.obstacles import Ball, BallParameters
from saphari_drake.simulation.world.plant import PlantParameters

robot = lwr4(home=np.deg2rad([0.0, 30.0, 0.0, 90.0, 0.0, -60.0, 0.0]))

# %% [markdown]
# ## From joints to torque
# `add_cell` makes the world, `JointSensor` what the controllers know of it, and the pipeline a torque that has passed
# the joint envelope.


# %%
def wired(observer):
    """Return the diagram, and the parts of its pipeline."""
    builder = DiagramBuilder()
    cell = add_cell(builder, robot, [Ball(BallParameters())], PlantParameters(rigid_cover=True))
    sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(period=0.002)))
    builder.Connect(cell.robot_state, sensor.get_input_port())
    params = NullSpacePipelineParameters(controller=NullSpaceComplianceParameters(observer=observer))
    parts = add_null_space_pipeline(builder, robot, sensor.get_output_port(0), sensor.get_output_port(1), params)
    builder.Connect(parts.torque_output, cell.torque_input)
    return builder.Build(), parts


BlockDiagram(wired("momentum")[0])


# %%
def run(observer, seconds=4.0):
    """Return the task error (m) over time."""
    diagram, parts = wired(observer)
    simulator, error = Simulator(diagram), []
    port = parts.controller.GetOutputPort("task_error")
    context = parts.controller.GetMyContextFromRoot(simulator.get_context())
    for time in np.arange(0.05, seconds, 0.05):
        simulator.AdvanceTo(time)
        error.append([time, np.linalg.norm(port.Eval(context)[-3:])])
    return np.array(error)


without, with_observer = run("none"), run("momentum")

# %%
plt.plot(without[:, 0], 1e3 * without[:, 1], label="no observer")
plt.plot(with_observer[:, 0], 1e3 * with_observer[:, 1], label="momentum observer")
plt.gca().set(xlabel="t [s]", ylabel="error of the end effector [mm]")
plt.legend()

# %%
assert without[-1, 1] > 0.3e-3 and with_observer[-1, 1] < 0.02 * without[-1, 1]
