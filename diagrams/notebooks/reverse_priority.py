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
# # Constraints that hold, and constraints that give way
# A planar arm is asked to a point that a hard bound forbids, and then to one that a soft bound forbids. Reverse
# priority starts with the lowest level and lets each level above correct what those below it gave, so that the hard
# bound has the last word, the task the one before, and the soft bound gives way exactly as far as the task needs.

# %%
import matplotlib.pyplot as plt
import numpy as np

from saphari_drake import planar_6r
from saphari_drake.control.reverse_priority import (
    Bound,
    PriorityStack,
    plane_distance,
    position_reference,
    position_task,
)

robot = planar_6r()
y4 = plane_distance(robot, "link_5", [0.0, 1.0, 0.0])  # y at the end of the fourth link
hard, soft = [Bound(y4, upper=0.5)], [Bound(y4, lower=-0.5)]
stack = PriorityStack(robot, [hard, position_task(robot, "tip", "xy"), soft])


# %% [markdown]
# ## A cycle is one call
# `solve` takes positions, where the task should be, and the period; it returns velocities within the joints' limits,
# and how active each constraint is, from 0 to 1.


# %%
def run(goal, q, period=0.005, seconds=10.0):
    """Drive the arm to a goal; return its last posture, and y₄ and the distance from the goal over time."""
    told, way = [], np.linspace(0.0, 1.0, round(0.7 * seconds / period))
    start = tip(q)
    for k in range(round(seconds / period)):
        at = start + way[min(k, len(way) - 1)] * (goal - start)
        reference = position_reference(at, np.zeros(3))[None]
        result = stack.solve(q, np.zeros(6), reference, np.zeros((0, 6)), period)
        q = q + period * result.v
        told.append([result.x[0], np.linalg.norm(goal - tip(q))])
    return q, np.array(told)


def tip(q):
    """Return the position of the end effector (m)."""
    link, X_LF = robot.frame("tip")
    return robot.kinematics(q).position(link, X_LF.translation())


q, first = run(np.array([4.0, 3.0, 0.0]), robot.home)
_, second = run(np.array([2.0, -3.0, 0.0]), q)

# %% [markdown]
# ## What came of it
# The first goal needs y₄ above 0.5 m: the arm stops half a metre short of it, and nowhere crosses the bound. The
# second needs y₄ below −0.5 m: the soft bound gives way, and the goal is reached.

# %%
figure, axes = plt.subplots(2, 1, sharex=True)
time = 0.005 * np.arange(len(first) + len(second))
both = np.vstack([first, second])
axes[0].plot(time, both[:, 0])
axes[0].axhline(0.5, color="red")
axes[0].axhline(-0.5, color="orange", linestyle="--")
axes[0].set_ylabel("y₄ [m]")
axes[1].plot(time, both[:, 1])
axes[1].set(xlabel="t [s]", ylabel="distance from the goal [m]")

# %%
assert both[:, 0].max() <= 0.5
assert abs(first[-1, 1] - 0.5) < 0.005 and second[-1, 1] < 0.005
