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
# # Around an obstacle, by looking ahead
# Predictive control plans ten periods ahead: near the target, cheap in velocity, and never nearer than `d_min` to
# what is seen. Here the arm turns past a ball in its way; without the ball it would hit it.

# %%
import matplotlib.pyplot as plt
import numpy as np

from saphari_drake import lwr4
from saphari_drake.control import NmpcParameters
from saphari_drake.control.nmpc import NmpcReference, NmpcStatus, TestPoint, nmpc_step
from saphari_drake.control.nmpc.law import at_rest
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.messages import ObstaclePoints

robot = lwr4()
points = [TestPoint("elbow", "link_4", d_min=0.2), TestPoint("wrist", "link_6", d_min=0.2)]
problem = NmpcProblem(robot, "link_7", points, NmpcParameters(velocity_scale=[0.4]))

# %% [markdown]
# ## A target, and something in between
# The target is the end effector's pose after a turn by 80° about the base; the obstacle is half-way, where the wrist
# would pass below it.

# %%
q_start = robot.home + np.deg2rad([-40.0, 0, 0, 0, 0, 0, 0])
q_goal = robot.home + np.deg2rad([40.0, 0, 0, 0, 0, 0, 0])
goal = robot.kinematics(q_goal)
reference = NmpcReference(goal.position(6, np.zeros(3))[None], goal.R_WL[6][None])
between = robot.kinematics(robot.home).position(5, np.zeros(3)) + np.array([0.0, 0.0, 0.12])


def run(obstacles):
    """Close the loop over a robot that obeys; return the distance of its wrist from the ball, and how it ended."""
    q, memory, distance, statuses = q_start.copy(), at_rest(problem, q_start), [], set()
    for _ in range(60):
        memory = nmpc_step(problem, memory, q, reference, obstacles, 0.0)
        statuses.add(memory.status)
        for _ in range(10):  # between the samples too
            q = q + 0.01 * memory.command
            distance.append(np.linalg.norm(robot.kinematics(q).position(5, np.zeros(3)) - between))
    return np.array(distance), q, statuses


blind, _, _ = run(ObstaclePoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0.0))
seeing, q_end, statuses = run(ObstaclePoints(between[None], np.zeros((1, 3)), np.zeros(1), 0.0))

# %% [markdown]
# ## Distance kept, target reached
# What a step could not do would be in its status: a distance that had to be relaxed, a stop, a problem without
# solution.

# %%
time = 0.01 * np.arange(len(seeing))
plt.plot(time, blind, label="not told of the obstacle")
plt.plot(time, seeing, label="told")
plt.axhline(0.2, color="red", linestyle="--")
plt.gca().set(xlabel="t [s]", ylabel="wrist from the obstacle [m]")
plt.legend()

# %%
error = np.linalg.norm(robot.kinematics(q_end).position(6, np.zeros(3)) - reference.p_WE[0])
assert blind.min() < 0.17 and seeing.min() >= 0.2 - 1e-9
assert error < 5e-3 and statuses <= {NmpcStatus.SOLVED, NmpcStatus.UNCONVERGED}, (error, statuses)
