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
# # Pushed anywhere, soft there
# A push of 20 N on link 5 of an arm without force sensors: the momentum observer tells its torque, the known point
# makes a force of it, and the arm answers as a spring of 500 N/m at that point. It should give way by F/K = 40 mm.

# %%
import matplotlib.pyplot as plt
import numpy as np

from saphari_drake import evaluate_dynamics, lwr4
from saphari_drake.control.contact import contact_impedance_torque
from saphari_drake.control.contact.law import ImpedanceGains
from saphari_drake.estimation.contact_force import estimate_contact_force
from saphari_drake.estimation.momentum_observer import advance_integral, discrete_gain, residual

robot = lwr4()
link, p_LC = 4, np.array([0.0, 0.06, 0.1])
gains = ImpedanceGains(500.0 * np.eye(3), 80.0 * np.eye(3), None, np.full(7, 8.0), 0.0, 100.0)
K_I = discrete_gain(np.full(7, 50.0), 0.001)

# %% [markdown]
# ## The loop, in arrays
# Everything between the measured joint state and the torque is four calls. The plant is M q̈ + C q̇ + g = τ + JᵀF.

# %%
q, v, told = robot.home.copy(), np.zeros(7), []
terms = evaluate_dynamics(robot, q, v)
integral, p_desired, torque = terms.M @ v, terms.point(link, p_LC).p_WC, terms.g
for k in range(3000):
    terms = evaluate_dynamics(robot, q, v)
    point = terms.point(link, p_LC)
    r = residual(terms.M @ v, integral, K_I)  # (45): the torque of the push
    F = estimate_contact_force(point.Jv_WC, r, rcond=0.05).F_W
    torque = contact_impedance_torque(terms, point, p_desired, F, r - point.Jv_WC.T @ F, gains).total()  # (61)
    integral = advance_integral(integral, r, torque, terms, 0.001)
    push = np.array([0.0, -20.0, 0.0]) if 500 <= k < 2000 else np.zeros(3)
    v = v + 0.001 * np.linalg.solve(terms.M, torque - terms.Cv - terms.g + point.Jv_WC.T @ push)
    q = q + 0.001 * v
    told.append([0.001 * k, -F[1], np.linalg.norm(point.p_WC - p_desired)])
told = np.array(told)

# %%
figure, axes = plt.subplots(2, 1, sharex=True)
axes[0].plot(told[:, 0], told[:, 1])
axes[0].set_ylabel("estimated force [N]")
axes[1].plot(told[:, 0], 1e3 * told[:, 2])
axes[1].axhline(40.0, color="grey", linestyle="--")
axes[1].set(xlabel="t [s]", ylabel="deflection [mm]")

# %%
assert abs(told[1900, 1] - 20.0) < 0.2 and abs(told[1900, 2] - 0.04) < 1e-3
