"""Which accelerations leave a joint able to stop within its limits, with bounded deceleration and jerk; compiled."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit

_HALVINGS = 40
RETURN_TIME = 0.1  # s, time constant with which a joint outside its limits is asked to come back. Assumed
RETURN_SPEED = 0.1  # share of the velocity limit at which it comes back at most. Assumed


@njit(cache=True)
def stop_position(v, a, A, J, T):
    """Return how far a joint still moves forward (m or rad, ≥ 0) until it first stands still.

    It keeps a for one period T, then lowers it with jerk J to −A and keeps that. A joint that changes its acceleration
    by J T at the beginning of each period never moves farther: at each instant it is decelerated at least as much.

    Parameters
    ----------
    v, a : float
        Velocity and acceleration now.
    A, J : float
        Deceleration (> 0) and jerk (> 0) of the stop.
    T : float
        Period (s).
    """
    peak = _farthest(v, a, T)
    s, v = v * T + 0.5 * a * T * T, v + a * T
    root = a * a + 2.0 * J * v
    t = (a + np.sqrt(root)) / J if root > 0.0 else 0.0  # when it stands still, if the ramp lasts as long
    ramp = max(a + A, 0.0) / J
    if 0.0 < t <= ramp:
        s += t * (v + t * (0.5 * a - J * t / 6.0))
    elif t > 0.0 or v > 0.0:
        s += ramp * (v + ramp * (0.5 * a - J * ramp / 6.0))
        v += ramp * (a - 0.5 * J * ramp)
        s += 0.5 * v * v / max(A, -a)
    return max(s, peak)


@njit(cache=True)
def _farthest(v, a, T):
    """Return how far forward (≥ 0) a joint comes within a period."""
    if v > 0.0 > v + a * T:
        return -0.5 * v * v / a
    return max(v * T + 0.5 * a * T * T, 0.0)


@njit(cache=True)
def fastest(v, a, J, T):
    """Return the largest velocity of a joint that keeps a for one period and then lowers it to zero with jerk J."""
    return v + a * T + 0.5 * a * a / J if a > 0.0 else v


@njit(cache=True)
def speed_bound(v, v_max, J, T):
    """Return the largest acceleration in the next period after which `fastest` is at most v_max."""
    left = v_max - v  # ≥ a T + (a T + a²/2J for a > 0)
    return J * (np.sqrt(4.0 * T * T + 2.0 * left / J) - 2.0 * T) if left > 0.0 else left / T


@njit(cache=True)
def largest_acceleration(q, v, q_max, v_max, A, J, T):
    """Return the largest acceleration (+inf: any) during the next period after which a stop within limits exists.

    After the period, `fastest` is at most v_max and the joint stops before q_max, both by the policy of
    `stop_position`. The result may be lower than what the actuators can do: then the limit cannot be kept.
    """
    a = speed_bound(v, v_max, J, T)
    if _stops_at(q, v, a, A, J, T) <= q_max:
        return a
    low, high = -(v + v_max) / T, a
    if _stops_at(q, v, low, A, J, T) > q_max:
        return low
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _stops_at(q, v, middle, A, J, T) <= q_max:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True)
def kept_acceleration(q, v, a, q_max, margin, v_max, A, J, J_full, T):
    """Return `largest_acceleration`, with a position limit that noise or a wrong model does not make impossible.

    The fullest stop lowers the acceleration a of now with jerk J_full to −A. As long as it ends before q_max, the limit
    is kept. Where it ends within the margin (rad or m) beyond, as from a measured position on the limit, or where the
    joint is beyond the margin already, the joint may go no farther outward and comes back with `RETURN_TIME`, at most
    as hard as by that stop. In between the limit is q_max + margin.
    """
    fullest = max(a - J_full * T, -A)
    end = _stops_at(q, v, fullest, A, J, T)
    if end <= q_max:
        return largest_acceleration(q, v, q_max, v_max, A, J, T)
    if q < q_max + margin < end:
        return largest_acceleration(q, v, q_max + margin, v_max, A, J, T)
    inward = min(max(q - q_max, 0.0) / RETURN_TIME, RETURN_SPEED * v_max)
    if v <= -inward:
        back = speed_bound(v, -inward, J, T)
    else:
        back = min(-v / T, -speed_bound(-v, inward, J, T))
    return min(max(fullest, back), speed_bound(v, v_max, J, T))


@njit(cache=True)
def _stops_at(q, v, a, A, J, T):
    """Return the largest position of a joint that keeps a for the next period, and then stops."""
    stopped = q + v * T + 0.5 * a * T * T + stop_position(v + a * T, a, A, J, T)
    return max(stopped, q + _farthest(v, a, T))


@njit(cache=True)
def acceleration_bounds(q, v, q_min, q_max, v_max, A, J, T, low, high):
    """Write the bounds (n,) of the accelerations in the next period after which each joint can stop within limits."""
    for i in range(len(q)):
        high[i] = largest_acceleration(q[i], v[i], q_max[i], v_max[i], A[i], J[i], T)
        low[i] = -largest_acceleration(-q[i], -v[i], -q_min[i], v_max[i], A[i], J[i], T)


@njit(cache=True)
def kept_bounds(q, v, a, q_min, q_max, margin, v_max, A, J, J_full, T, low, high):
    """Write the bounds (n,) of the accelerations in the next period by `kept_acceleration`, with a (n,) of now."""
    for i in range(len(q)):
        high[i] = kept_acceleration(q[i], v[i], a[i], q_max[i], margin, v_max[i], A[i], J[i], J_full[i], T)
        low[i] = -kept_acceleration(-q[i], -v[i], -a[i], -q_min[i], margin, v_max[i], A[i], J[i], J_full[i], T)
