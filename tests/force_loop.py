"""An arm that holds a force against a hand, for the tests of the law and of its stability."""

import numpy as np

from saphari_drake.control.contact.force_system import ContactForceController
from saphari_drake.control.contact.law import contact_force_torque
from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.estimation.contact_force import ContactForceParameters, estimate_contact_force
from saphari_drake.robots.dynamics import evaluate_dynamics

RCOND = ContactForceParameters().rcond
Q = np.deg2rad([90.0, -30.0, 0.0, 60.0, 0.0, -90.0, 0.0])
TIP = np.array([0.0, 0.0, 0.072])


def gains_of(robot, **params):
    return ContactForceController(robot, ContactForceControlParameters(**params)).gains


def simulate(robot, gains, hand, F_d, seconds, K_I=100.0, step=0.001, cycles=5, v=None):
    """Arm, hand and residual: `hand(p, v)` is its force, `F_d(F̂)` the desired one; return force and velocity (T, 3).

    The residual is the first-order lag that the momentum observer is; the law is sampled every `cycles` steps.
    """
    q, v, r = Q.copy(), np.zeros(7) if v is None else np.array(v), np.zeros(7)
    keep = np.exp(-K_I * step)
    forces, velocities = [], []
    for k in range(round(seconds / step)):
        terms = evaluate_dynamics(robot, q, v)
        point = terms.point(5, TIP)
        F = hand(point.p_WC, point.v_WC)
        if k % cycles == 0:
            estimate = estimate_contact_force(point.Jv_WC, r, RCOND).F_W
            torque = contact_force_torque(terms, point, estimate, F_d(estimate), np.zeros(7), gains)[0].total()
        r = keep * r + (1.0 - keep) * point.Jv_WC.T @ F
        v = v + step * np.linalg.solve(terms.M, torque - terms.Cv - terms.g + point.Jv_WC.T @ F)
        q = q + step * v
        forces.append(F)
        velocities.append(point.v_WC)
        if np.linalg.norm(point.v_WC) > 20.0:
            break
    return np.array(forces), np.array(velocities)


def spring(robot, stiffness, damping, F0):
    """A hand at rest that presses with F0 at the start."""
    p0 = evaluate_dynamics(robot, Q, np.zeros(7)).point(5, TIP).p_WC + F0 / stiffness
    return lambda p, v: stiffness * (p0 - p) - damping * v
