"""The law of a person's hand: a spring and a damper towards where the person wants it, compiled."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.curves import quintic
from saphari_drake.math.products import product
from saphari_drake.math.rotations import rotation_exp, rotation_log


@njit(cache=True)
def hand_wrench(state, p_set, R_set, direction, most, stiffness, damping, turn_stiffness, turn_damping):
    """Return the torque and the force on the hand (6,) in the world (Nm, N).

    Parameters
    ----------
    state : (13,) array
        The hand's quaternion, position, angular velocity and velocity, as a plant gives them.
    p_set, R_set : (3,) and (3, 3) arrays
        Where the person wants the hand.
    direction, most : (3,) array, float
        Along this direction the spring pulls with no more than `most` (N).
    stiffness, damping, turn_stiffness, turn_damping : float
        N/m, Ns/m, Nm/rad, Nms/rad.
    """
    spring = stiffness * (p_set - state[4:7])
    along = np.sum(direction * spring)
    if along > most:
        spring += (most - along) * direction
    turn = rotation_log(product(R_set, _rotation(state[:4]).T))
    return np.concatenate((turn_stiffness * turn - turn_damping * state[7:10], spring - damping * state[10:13]))


@njit(cache=True)
def _rotation(quaternion):
    """Return the rotation matrix of a quaternion of any length, as half its angle about its axis, twice."""
    w, v = quaternion[0], quaternion[1:]
    length = np.sqrt(np.sum(v * v))
    return rotation_exp(v * (2.0 * np.arctan2(length, w) / length)) if length > 0.0 else np.eye(3)


@njit(cache=True)
def retreat(p_start, p_goal, a):
    """Return the position after the share `a` of the time of a straight way from rest to rest."""
    return p_start + quintic(a)[0] * (p_goal - p_start)


@njit(cache=True)
def travel(p_start, R_start, p_goal, R_goal, a):
    """Return position and orientation after the share `a` of the time of a way around the robot, from rest to rest.

    The way bulges outward, away from the point 0.6 m above the base, and turns at a steady rate about one axis.
    """
    s = quintic(a)[0]
    outward = 0.5 * (p_start + p_goal) - np.array([0.0, 0.0, 0.6])
    outward /= max(np.sqrt(np.sum(outward * outward)), 1e-6)
    turn = rotation_log(product(R_start.T, R_goal))
    p = p_start + s * (p_goal - p_start) + 0.8 * s * (1.0 - s) * outward
    return p, product(R_start, rotation_exp(s * turn))
