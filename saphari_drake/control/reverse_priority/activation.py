"""Smooth activation of a unilateral constraint x ≤ x̄ by its distance to the bound and its velocity towards it.

The rule (31) is a step in both. Here each step becomes the quintic s(a) = 6a⁵ − 15a⁴ + 10a³ over a buffer, so that the
activation h = h_pos h_vel has continuous first and second derivatives. Both buffers lie on the side where the rule
says 0: h = 1 wherever (31) says 1.
"""

from __future__ import annotations

from saphari_drake.compiled import njit
from saphari_drake.math.curves import quintic


@njit(cache=True)
def position_activation(x, bound, buffer):
    """Return h_pos = s((x − x̄ + β_p)/β_p): 0 up to the buffer, 1 from the bound x̄ on."""
    return quintic((x - bound + buffer) / buffer)[0]


@njit(cache=True)
def velocity_activation(rate, buffer):
    """Return h_vel = s((ẋ_d + β_v)/β_v): 1 for a velocity towards the bound, 0 for one of β_v or more away from it."""
    return quintic((rate + buffer) / buffer)[0]


@njit(cache=True)
def activation(x, rate, bound, position_buffer, velocity_buffer):
    """Return h = h_pos h_vel of the upper bound x ≤ x̄.

    Parameters
    ----------
    x, bound, position_buffer : float
        Component, its bound x̄ and the buffer β_p > 0, in the same unit. A lower bound is the upper one of −x.
    rate, velocity_buffer : float
        Nominal velocity ẋ_d of eq. (30), and the buffer β_v > 0.
    """
    return position_activation(x, bound, position_buffer) * velocity_activation(rate, velocity_buffer)
