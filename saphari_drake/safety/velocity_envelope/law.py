"""The nearest velocity that every joint can take on, and stop from, within its limits; compiled."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.safety.joint_envelope.stopping import acceleration_bounds, fastest, speed_bound, stop_position

Array = NDArray[np.float64]
_ROUNDING = 1e-5  # share of an acceleration by which bounds may contradict one another


class VelocityStatus(IntEnum):
    """Which limit holds a command back, the most urgent one; also published as a number."""

    FREE = 0  # the command is applied as it is
    JERK = 1
    ACCELERATION = 2
    SPEED = 3
    POSITION = 4
    BRAKING = 5  # no velocity keeps all limits, as when the joints do not follow: the fullest braking
    BAD_INPUT = 6  # state or command are not known: braking to rest, within all limits that are known


FREE, JERK, ACCELERATION, SPEED, POSITION, BRAKING = (int(status) for status in list(VelocityStatus)[:6])


class Course(NamedTuple):
    """Where the applied velocities lead, all (n,)."""

    q: Array  # rad or m
    v: Array  # rad/s or m/s
    a: Array  # rad/s² or m/s², of the period before


class LimitedVelocity(NamedTuple):
    """Result of `limited_velocity`."""

    course: Course  # at the end of the period; its v is the velocity to apply
    status: int  # a VelocityStatus
    joint: int  # the one whose limit is most urgent, −1 for none
    margin: float  # share of the envelope that is left at the nearest limit: 1 in its middle, negative outside


@njit(cache=True)
def limited_velocity(bounds, course, measured, command):
    """Return the velocity nearest to `command` (n,) at the end of this period that leaves a stop within all limits.

    Each joint for itself. Its acceleration over the period is bounded by ±A, by ±J T around that of the period before,
    and by `acceleration_bounds`, so that a stop with A and J, from where it is led, ends within its limits. A command
    that is farther away is approached with the acceleration that jerk J can take back in time, so that none overshoots.

    Guarantee: speed, acceleration, jerk and position limits hold along the course, from every course that they hold on
    and from which a stop exists, whatever is commanded: to lower each acceleration with J to −A is always allowed. The
    joints keep their position limits if they are never ahead of the course by more than the margin that is kept. A
    joint that is farther from the course than `bounds.slip` moves the course with it, and voids that; see BRAKING.

    Parameters
    ----------
    bounds : Bounds
    course : Course
        At the beginning of the period.
    measured : (n,) array
        Positions there; NaN where they are not known, and then the course stands for them.
    command : (n,) array
    """
    T, n = bounds.period, len(command)
    q, v, a = course.q.copy(), course.v, np.empty(n)
    low, high = np.empty(n), np.empty(n)
    for i in range(n):
        if np.isfinite(measured[i]):
            q[i] = min(max(q[i], measured[i] - bounds.slip[i]), measured[i] + bounds.slip[i])
    acceleration_bounds(q, v, bounds.q_min, bounds.q_max, bounds.v_max, bounds.acceleration, bounds.jerk, T, low, high)
    status, joint = FREE, -1
    for i in range(n):
        A, step = bounds.acceleration[i], bounds.jerk[i] * T
        wish = _approach(v[i], command[i], bounds.jerk[i], T)
        a[i], kind = _allowed(wish, low[i], high[i], max(course.a[i] - step, -A), min(course.a[i] + step, A), A)
        if kind == SPEED or kind == POSITION:
            towards = 1.0 if wish > a[i] else -1.0
            by_speed = towards * a[i] >= speed_bound(towards * v[i], bounds.v_max[i], bounds.jerk[i], T) * (1.0 - 1e-9)
            kind = SPEED if by_speed else POSITION
        if kind == FREE and abs(command[i] - v[i] - a[i] * T) > 1e-12:
            kind = JERK  # on its way
        if kind > status:
            status, joint = kind, i
    led = Course(q + v * T + 0.5 * a * T * T, v + a * T, a)
    return LimitedVelocity(led, status, joint, _margin(bounds, led))


@njit(cache=True)
def _approach(v, wish, J, T):
    """Return the acceleration that leads to a velocity at once, if that is one step of jerk, or without overshoot."""
    a = (wish - v) / T
    if abs(a) <= J * T:
        return a
    sign = 1.0 if a > 0.0 else -1.0
    return sign * max(J * T, speed_bound(sign * v, sign * wish, J, T))


@njit(cache=True)
def _allowed(wish, low, high, least, most, A):
    """Return the acceleration within all bounds that is nearest to the wish, and which kind of bound holds it back.

    `low` and `high` leave a stop possible, `least` and `most` are what the jerk reaches. If they contradict one
    another, the jerk counts.
    """
    slack = _ROUNDING * A
    if low > min(high, most) + slack or high < least - slack:
        side = 0.5 * (low + high) if low > high else (low if low > most else high)
        return min(max(side, least), most), BRAKING
    a = min(max(wish, least), most)
    kind = FREE if a == wish else (ACCELERATION if abs(a) >= A * (1.0 - 1e-12) else JERK)
    if a > high or a < low:
        return min(max(min(max(a, low), high), least), most), POSITION
    return a, kind


@njit(cache=True)
def _margin(bounds, course):
    q, v, a = course
    left = 1.0
    for i in range(len(q)):
        for side in (-1.0, 1.0):
            x, bound = (q[i], bounds.q_max[i]) if side > 0.0 else (-q[i], -bounds.q_min[i])
            V, A, J = side * v[i], side * a[i], bounds.jerk[i]
            led = V + 0.5 * A * A / J if A > 0.0 else V
            left = min(left, 1.0 - max(led, fastest(V, 0.0, J, 0.0)) / bounds.v_max[i])
            if bound < np.inf:
                stopped = x + stop_position(V, A, bounds.acceleration[i], J, 0.0)
                left = min(left, 2.0 * (bound - stopped) / (bounds.q_max[i] - bounds.q_min[i]))
    return left
