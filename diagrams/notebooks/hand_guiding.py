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
# # Two hands on one arm
# A hand that leads a point feels a mass with damping: it moves with F/D in the end. Whoever comes second, at the body
# or at the tip, gets what the first leaves free, and does not disturb it.

# %%
import matplotlib.pyplot as plt
import numpy as np

from saphari_drake import evaluate_dynamics, lwr4
from saphari_drake.control import HandGuidingParameters
from saphari_drake.control.hand_guiding.law import HandGuiding
from saphari_drake.control.hand_guiding.system import sense
from saphari_drake.messages import SkinContact, SkinReading

robot = lwr4(home=np.deg2rad([90.0, -60.0, 0.0, 80.0, 0.0, -10.0, 0.0]))
params = HandGuidingParameters(feedback="commanded")
guiding = HandGuiding(robot, params)

# %% [markdown]
# ## One cycle: state and forces in, next state and commands out
# The robot here does exactly what is commanded. First a hand pulls the tip with 5 N; one second later a second hand
# pushes link 3 through the skin. A hand that is there from the start is not followed before it has let go once.

# %%
state = guiding.start(evaluate_dynamics(robot, robot.home, np.zeros(7)))
p_skin, told = np.array([0.0, 0.065, 0.1]), []
pull, push = np.array([0.0, 0.0, 5.0]), np.array([0.0, 8.0, 0.0])
for k in range(1000):
    terms = evaluate_dynamics(robot, state.q, state.v)
    touches = [SkinContact(2, p_skin, np.array([0.0, 1.0, 0.0]), terms.R_WL[2].T @ push)] if k > 500 else []
    reading = SkinReading(tuple(touches), stamp=state.now)
    hands = sense(terms, reading, np.concatenate([np.zeros(3), pull if k > 10 else 0.0 * pull]), guiding.tip)
    tip, elbow = terms.point(*guiding.tip).v_WC, terms.point(2, p_skin).v_WC
    told.append([state.now, tip[2], np.linalg.norm(elbow)])
    state, output = guiding.step(state, terms, hands)
told = np.array(told)

# %%
plt.plot(told[:, 0], told[:, 1], label="tip, along the pull")
plt.plot(told[:, 0], told[:, 2], label="point of link 3")
plt.axhline(5.0 / params.end_effector.damping[0], color="grey", linestyle="--", label="F/D")
plt.gca().set(xlabel="t [s]", ylabel="speed [m/s]")
plt.legend()

# %%
before, after = told[480, 1], told[600:, 1]
assert abs(before - 5.0 / params.end_effector.damping[0]) < 0.03 * before
assert np.abs(after - before).max() < 0.05 * before and told[600:, 2].max() > 0.01
