"""The nearest torque that keeps every joint inside its envelope; compiled."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply, cholesky, solve_lower, solve_upper
from saphari_drake.safety.joint_envelope.nearest import nearest
from saphari_drake.safety.joint_envelope.stopping import (
    acceleration_bounds,
    fastest,
    kept_bounds,
    speed_bound,
    stop_position,
)

Array = NDArray[np.float64]


class EnvelopeStatus(IntEnum):
    """Which limit holds a command back, the most urgent one; also published as a number."""

    FREE = 0  # the command is applied as it is
    TORQUE = 1
    RATE = 2  # of torque
    SPEED = 3
    POSITION = 4
    ENERGY = 5
    BRAKING = 6  # no torque keeps all limits, as under a push stronger than the motors: the fullest braking
    BAD_INPUT = 7  # state or command are not known


FREE, TORQUE, RATE, SPEED, POSITION, ENERGY, BRAKING = (int(status) for status in list(EnvelopeStatus)[:7])


class Motion(NamedTuple):
    """What the envelope sees of the robot, all (n,) but M (n, n)."""

    q: Array  # rad or m
    v: Array  # rad/s or m/s
    M: Array
    h: Array  # C q̇ + g and viscous friction, Nm or N
    tau_ext: Array  # what the environment does to the robot, Nm or N
    tau: Array  # given in the period before, Nm or N


class Limited(NamedTuple):
    """Result of `limited_torque`."""

    torque: Array  # (n,)
    status: int  # an EnvelopeStatus
    joint: int  # the one whose limit is most urgent, −1 for none
    margin: float  # share of the envelope that is left at the nearest limit: 1 in its middle, negative outside


@njit(cache=True)
def limited_torque(envelope, motion, command):
    """Return the torque nearest to `command` (n,) in the metric of M⁻¹ that leaves a stop within all limits possible.

    Accelerations q̈ = M⁻¹(τ + τ_ext − C q̇ − g) are bounded by `acceleration_bounds`, torques by size and rate. If the
    kinetic energy at the velocities that these accelerations lead to is above its bound, a stop is mixed in.

    Guarantee: with M, C, g and τ_ext exact, |τ_ext| within the share kept for a push, and rates of τ_ext and of C q̇ + g
    within the reserve, a state from which a stop exists leads to another one: to lower each acceleration with the sure
    jerk to the sure deceleration is always among the torques allowed. (Del Prete, RA-L 2018, for accelerations without
    jerk; a limited rate of torque adds the jerk.) The bound of the energy holds by its reserve: evidence from trials,
    no proof.

    Where no torque keeps all bounds, positions are bounded by `kept_bounds`: a joint that is measured on its limit, or
    a little beyond, is held and brought back alone. In the metric of M⁻¹ the bound of a joint changes the torque of
    that joint only, unless a torque is at a limit of its own. If that is not possible either, status BRAKING: the
    torque nearest to that of a stop, within size and rate.
    """
    e, v, n = envelope, motion.v, len(motion.q)
    M_inv, offset = _inverse(motion.M), motion.h - motion.tau_ext
    now, wish = apply(M_inv, motion.tau - offset), apply(M_inv, command - offset)
    C, low, high = np.empty((2 * n, n)), np.empty(2 * n), np.empty(2 * n)
    C[:n], C[n:] = np.eye(n), motion.M
    acceleration_bounds(motion.q, v, e.q_min, e.q_max, e.v_max, e.deceleration, e.jerk, e.period, low, high)
    for i in range(n):
        before = min(max(motion.tau[i], -e.tau_max[i]), e.tau_max[i])
        step = e.tau_rate[i] * e.period
        low[n + i] = max(-e.tau_max[i], before - step) - offset[i]
        high[n + i] = min(e.tau_max[i], before + step) - offset[i]
    a, stop, active = np.empty(n), np.empty(n), np.zeros(2 * n, dtype=np.int64)
    found = nearest(M_inv, wish, C, low, high, a, active)
    if not found:
        A, J, J_full = e.deceleration, e.jerk, e.jerk_full
        kept_bounds(motion.q, v, now, e.q_min, e.q_max, e.margin, e.v_max, A, J, J_full, e.period, low, high)
        found = nearest(M_inv, wish, C, low, high, a, active)
    status, joint = _most_urgent(e, v, offset, high, low, active)
    fast = found and _led_energy(e, motion.M, v, a) > e.energy
    if not found or fast:
        wish = _stop(e, v, now, low, high)
        found = nearest(M_inv, wish, C, low, high, stop, active)
        status, joint = ENERGY if found and fast else BRAKING, np.argmax(np.abs(v) / e.v_max)
        if not found:
            nearest(M_inv, wish, C[n:], low[n:], high[n:], stop, active[n:])
        share = _least_share(e, motion.M, v, a, stop) if found and fast else 1.0
        a = (1.0 - share) * a + share * stop
    torque = command.copy() if status == FREE else apply(motion.M, a) + offset
    for i in range(n):
        torque[i] = min(max(torque[i], low[n + i] + offset[i]), high[n + i] + offset[i])
    return Limited(torque, status, joint, _margin(e, motion.q, v, a))


@njit(cache=True)
def predicted(envelope, motion, torques, delay, velocity_age):
    """Return the motion when a torque given now begins to act, `delay` periods ahead.

    Parameters
    ----------
    torques : (k, n) array
        Torques of the k > `delay` periods before, the latest last; those that still wait act one after the other.
    velocity_age : float
        How much older than q the measured velocity is (s), at most a period.
    """
    M_inv, offset, T = _inverse(motion.M), motion.h - motion.tau_ext, envelope.period
    q, v = motion.q.copy(), motion.v + velocity_age * apply(M_inv, torques[len(torques) - 1 - delay] - offset)
    for k in range(len(torques) - delay, len(torques)):
        v = v + T * apply(M_inv, torques[k] - offset)
        q = q + T * v
    return Motion(q, v, motion.M, motion.h, motion.tau_ext, torques[-1])


@njit(cache=True)
def _inverse(M):
    """Return M⁻¹ of a positive definite matrix (n, n), NaN if it is not."""
    n = len(M)
    L, columns = np.zeros((n, n)), np.eye(n)
    cholesky(M, L)
    for column in columns:
        solve_lower(L, column, n)
        solve_upper(L, column, n)
    return columns


@njit(cache=True)
def _stop(e, v, now, low, high):
    """Return accelerations (n,) that stop the joints, from where they are led by those of now, within their bounds."""
    a = np.empty(len(v))
    for i in range(len(v)):
        led = v[i] + 0.5 * now[i] * abs(now[i]) / e.jerk[i]
        a[i] = min(max(-led / (5.0 * e.period), -e.deceleration[i]), e.deceleration[i])
        if low[i] <= high[i]:
            a[i] = min(max(a[i], low[i]), high[i])
    return a


@njit(cache=True)
def _most_urgent(e, v, offset, high, low, active):
    """Return status and joint of the active limit that comes first in `EnvelopeStatus` from its end."""
    n, status, joint = len(v), FREE, -1
    for i in range(n):
        if active[i] != 0:
            bound = active[i] * (high[i] if active[i] > 0 else low[i])
            by_speed = bound >= speed_bound(active[i] * v[i], e.v_max[i], e.jerk[i], e.period)
            kind = SPEED if by_speed else POSITION
        elif active[n + i] != 0:
            torque = offset[i] + (high[n + i] if active[n + i] > 0 else low[n + i])
            kind = TORQUE if abs(torque) >= e.tau_max[i] else RATE
        else:
            continue
        if kind > status:
            status, joint = kind, i
    return status, joint


@njit(cache=True)
def _led_energy(e, M, v, a):
    """Return the kinetic energy (J) at the velocities that the accelerations lead to before they can be taken back."""
    led = v + a * (2.0 * e.period + 0.5 * np.abs(a) / e.jerk)
    return 0.5 * (led * apply(M, led)).sum()


@njit(cache=True)
def _least_share(e, M, v, a, stop):
    """Return the least share of a stop, in steps of 2⁻¹², with which the energy stays below its bound."""
    low, high = 0.0, 1.0
    for _ in range(12):
        middle = 0.5 * (low + high)
        if _led_energy(e, M, v, (1.0 - middle) * a + middle * stop) > e.energy:
            low = middle
        else:
            high = middle
    return high


@njit(cache=True)
def _margin(e, q, v, a):
    left = 1.0
    for i in range(len(q)):
        for side in (-1.0, 1.0):
            x, bound = (q[i], e.q_max[i]) if side > 0.0 else (-q[i], -e.q_min[i])
            V, A = side * v[i] + side * a[i] * e.period, side * a[i]
            left = min(left, 1.0 - fastest(V, A, e.jerk[i], e.period) / e.v_max[i])
            if bound < np.inf:
                stopped = x + stop_position(V, A, e.deceleration[i], e.jerk[i], e.period)
                left = min(left, 2.0 * (bound - stopped) / (e.q_max[i] - e.q_min[i]))
    return left
