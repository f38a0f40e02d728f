"""Whether a stop keeps away from all that people can reach meanwhile, and which command passes; compiled."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.safety.verified_stop.geometry import ball_distance, shape_poses
from saphari_drake.safety.verified_stop.touch import soft_shares

Array = NDArray[np.float64]


class StopStatus(IntEnum):
    """What becomes of a command, also published as a number."""

    PASSING = 0  # it is applied, as far as the accelerations allow in this cycle
    HOLDING = 1  # it has no verified stop; the velocity of the cycle before has, and is kept
    STOPPING = 2  # nor has that: the stop that was verified before is carried out
    BAD_INPUT = 3  # command or positions are not finite: the same
    STALE = 4  # the command was made too long ago: the same
    OBSTACLES_LOST = 5  # people or things are not known: the same


PASSING, HOLDING, STOPPING = (int(status) for status in list(StopStatus)[:3])


class Surroundings(NamedTuple):
    """What to keep away from: balls that move and grow, from now on."""

    p: Array  # (m, 3), centres in the world (m)
    v: Array  # (m, 3), their velocities
    radius: Array  # (m,), now, with all errors and separations
    growth: Array  # (m,), m/s


class Checked(NamedTuple):
    """Result of `checked_velocity`."""

    v: Array  # (n,), to apply
    status: int  # a StopStatus
    margin: float  # m, least that is left during the stop after it; infinite without surroundings
    stop_time: float  # s, that the stop takes


@njit(cache=True)
def checked_velocity(body, intervals, q, before, command, known, around, touch=None):
    """Return the velocity to apply in the cycle that begins.

    Candidates are the command, as near as the accelerations allow, and the velocity of the cycle before. The first one
    is applied after which a stop exists (`stop_margin` ≥ 0). Without one the robot goes on with the stop that was
    verified in the cycle before: v ← v (1 − T/t), t = max_j |v_j|/A_j, along the same joint path.

    Guarantee, by induction over cycles: if people come nearer with at most `growth`, links are where `q` says up to the
    error that `around` holds, and joints follow within `body.hold`, then no link touches a ball while the robot moves,
    and no joint leaves its limits, whatever is commanded. Where the robot stands, people may come to it. With `touch`
    they may also be touched, while it is slow enough for each touch to be soft, by the inertia where the stop begins.

    Parameters
    ----------
    body : Body
    intervals : int
    q, before, command : (n,) arrays
        Positions, the velocity applied in the cycle before, and the one that is asked for.
    known : bool
        Whether q, command and surroundings can be used; if not, the robot stops.
    around : Surroundings
    touch : Touch, optional
        Whom of them the robot may touch softly; default: nobody.
    """
    m = around.radius.shape[0]
    soft = np.zeros(m)
    if known:
        wish = _toward(before, command, body.deceleration * body.period)
        if touch is not None:
            soft = soft_shares(body.tree, touch, q, wish, m, _met(body, wish, around))
        margin = stop_margin(body, intervals, q, wish, around, soft)
        if margin >= 0.0:
            return Checked(wish, PASSING, margin, _stop_time(body, wish))
        if touch is not None:
            soft = soft_shares(body.tree, touch, q, before, m, _met(body, before, around))
        margin = stop_margin(body, intervals, q, before, around, soft)
        if margin >= 0.0 and _stop_time(body, before) > 0.0:
            return Checked(before.copy(), HOLDING, margin, _stop_time(body, before))
    time = _stop_time(body, before)
    v = before * max(0.0, 1.0 - body.period / time) if time > 0.0 else 0.0 * before
    if known and touch is not None:
        soft = soft_shares(body.tree, touch, q, v, m, _met(body, v, around))
    margin = stop_margin(body, intervals, q, v, around, soft) if known else np.nan
    return Checked(v, STOPPING, margin, _stop_time(body, v))


@njit(cache=True)
def _toward(before, command, change):
    """Return the velocity nearest to the command, on the way to it from the one before, that one cycle can reach."""
    share = np.max(np.abs(command - before) / change)
    return command.copy() if share <= 1.0 else before + (command - before) / share


@njit(cache=True)
def _stop_time(body, v):
    return np.max(np.abs(v) / body.deceleration)


@njit(cache=True)
def _met(body, v, around):
    """Return the distance (m) from which on nobody can be met in a stop from v."""
    hold, far = body.period + body.hold, 0.0
    stop = _stop_time(body, v)
    for s in range(body.link.shape[0]):
        far = max(far, np.sum(body.reach[s] * np.abs(v)) * (hold + 0.5 * stop))
    most = 0.0
    for o in range(around.radius.shape[0]):
        drift = np.sqrt(around.v[o, 0] ** 2 + around.v[o, 1] ** 2 + around.v[o, 2] ** 2)
        most = max(most, around.radius[o] + (around.growth[o] + drift) * (hold + stop))
    return far + most


@njit(cache=True)
def _way(t, hold, stop):
    """Return the way at time t in times of the full velocity, which lasts for `hold` and falls to zero over `stop`."""
    if t <= hold:
        return t
    braked = min(t - hold, stop)
    return hold + braked - 0.5 * braked * braked / stop


@njit(cache=True)
def stop_margin(body, intervals, q, v, around, soft=None):
    """Return the least distance (m) that is left in a stop from v at q: all of it, between its samples too.

    The joints go q + v s, s rising for a period and `body.hold` and then slowing down until t. In each interval of the
    time a link is at most its largest speed times the half way from where it is in the middle, and balls have the size
    of the interval's end. A pair that cannot meet at all is not looked at again. Negative too (−∞) if a joint would
    leave its limits or exceeds its speed. Of a ball with a share `soft` (m,) of v, down to which it may be touched, the
    part of the stop below that is not looked at.
    """
    stop, hold = _stop_time(body, v), body.period + body.hold
    total, count, m = hold + stop, body.link.shape[0], around.radius.shape[0]
    way = hold + 0.5 * stop
    for j in range(v.shape[0]):
        end = q[j] + v[j] * way
        if abs(v[j]) > body.v_max[j] * (1.0 + 1e-9) or (v[j] > 0.0 and end > body.q_max[j]):
            return -np.inf
        if v[j] < 0.0 and end < body.q_min[j]:
            return -np.inf
    if stop <= 0.0:
        return np.inf
    speed = np.zeros(count)
    for s in range(count):
        for j in range(v.shape[0]):
            if v[j] != 0.0:
                speed[s] += body.reach[s, j] * abs(v[j])
    shapes, balls, near, least = np.empty(count * m, np.int64), np.empty(count * m, np.int64), 0, np.inf
    links = np.empty((v.shape[0], 3, 3)), np.empty((v.shape[0], 3))
    poses = np.empty((count, 3, 3)), np.empty((count, 3))
    shape_poses(body, q, links, poses)
    until = np.full(m, total)
    if soft is not None:
        until = np.where(soft < 1.0, hold + (1.0 - soft) * stop, 0.0)
    for s in range(count):
        for o in range(m):
            if until[o] == 0.0:
                continue
            drift = np.sqrt(around.v[o, 0] ** 2 + around.v[o, 1] ** 2 + around.v[o, 2] ** 2)
            left = ball_distance(body, s, poses, around, o, 0.0) - speed[s] * way
            left -= around.radius[o] + (around.growth[o] + drift) * until[o]
            if left >= 0.0:
                least = min(least, left)
            else:
                shapes[near], balls[near] = s, o
                near += 1
    if near == 0:
        return least
    for k in range(intervals):
        begin, end = total * k / intervals, total * (k + 1) / intervals
        middle = _way(0.5 * (begin + end), hold, stop)
        half = max(middle - _way(begin, hold, stop), _way(end, hold, stop) - middle)
        shape_poses(body, q + middle * v, links, poses)
        for i in range(near):
            s, o = shapes[i], balls[i]
            if begin >= until[o]:
                continue
            drift = np.sqrt(around.v[o, 0] ** 2 + around.v[o, 1] ** 2 + around.v[o, 2] ** 2)
            left = ball_distance(body, s, poses, around, o, 0.5 * (begin + end)) - speed[s] * half
            left -= around.radius[o] + around.growth[o] * end + 0.5 * drift * (end - begin)
            least = min(least, left)
            if least < 0.0:
                return least
    return least
