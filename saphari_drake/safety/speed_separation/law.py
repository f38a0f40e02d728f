"""The protective separation distance, and the fastest that it allows; compiled."""

from typing import NamedTuple

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.safety.nearness import bounding_radius, fastest_end, nearest_possible, pair, posed, towards

_HALVINGS = 20


class Separation(NamedTuple):
    """Result of `permitted_scale`."""

    scale: float  # 0 … 1
    distance: float  # m, of the pair that scales, or that has the least left; infinite where nobody is
    protective: float  # m, of that pair at the full command
    shape: int  # of that pair; −1: none
    ball: int


@njit(cache=True)
def person_way(rule, speed, time):
    """Return how far (m) a person comes nearer in a time (s), seen coming with a speed (m/s)."""
    v = min(max(speed, 0.0), rule.person_speed)
    if rule.acceleration == np.inf:
        return rule.person_speed * time
    rise = min((rule.person_speed - v) / rule.acceleration, time)
    return v * time + 0.5 * rule.acceleration * rise * rise + rule.acceleration * rise * (time - rise)


@njit(cache=True)
def interpolated(at, nodes, values):
    """Return the value on the line through (nodes, values); beyond the last node in the ratio of the last value."""
    last = nodes.shape[0] - 1
    if at >= nodes[last]:
        return values[last] * at / nodes[last]
    k = 0
    while at > nodes[k + 1]:
        k += 1
    share = (at - nodes[k]) / (nodes[k + 1] - nodes[k])
    return values[k] + share * (values[k + 1] - values[k])


@njit(cache=True)
def protective_distance(rule, table, fastest, closing, coming):
    """Return S_p (m) of a pair.

    S_p = ∫v_h + v_r T_r + S_s + C + Z_d + Z_r, where v_h is integrated over T_r + T_s, T_s is the stopping time of the
    robot at this speed, and S_s its stopping distance in the share that v_r has of the fastest speed. A robot that
    stands needs none.

    Parameters
    ----------
    rule : Rule
    table : tuple of (k,) arrays
        Speeds (m/s), stopping times (s) and distances (m).
    fastest, closing, coming : float
        Speed of the robot's fastest end, v_r of the pair's point towards the person, and the person's speed towards
        the robot, as it is seen (m/s).
    """
    moves = fastest > 0.0
    time = interpolated(fastest, table[0], table[1]) if moves else 0.0
    stop = interpolated(fastest, table[0], table[2]) * min(max(closing, 0.0) / fastest, 1.0) if moves else 0.0
    way = person_way(rule, coming, rule.reaction + time)
    return way + max(closing, 0.0) * rule.reaction + stop + rule.kept


@njit(cache=True)
def permitted_scale(surface, motion, v, people, rule, table):
    """Return the largest share of the joint velocities v (n,) at which every pair keeps its protective distance.

    Pairs are each shape of the robot and each ball of a person. Scaling all joints alike keeps the path.

    Parameters
    ----------
    surface : Surface
    motion : TreeMotion
    v : (n,) array
    people : Balls
    rule : Rule
    table : tuple of (k,) arrays
        As `protective_distance` takes it.
    """
    poses, fastest, row = posed(surface, motion), fastest_end(surface, motion, v), np.empty(v.shape[0])
    scale, distance, protective, shape, ball, least = 1.0, np.inf, 0.0, -1, -1, np.inf
    most = protective_distance(rule, table, fastest, fastest, rule.person_speed)
    for s in range(surface.link.shape[0]):
        around = bounding_radius(surface, s)
        for o in range(people.radius.shape[0]):
            if nearest_possible(poses, s, around, people, o) >= min(most + least, np.inf if scale == 1.0 else most):
                continue
            away, p_WN, u = pair(surface, poses, s, people.p[o])
            d = away - people.radius[o]
            towards(motion, surface.link[s], p_WN, u, row)
            closing, coming = np.sum(row * v), -np.sum(u * people.v[o])
            full = protective_distance(rule, table, fastest, closing, coming)
            if scale == 1.0 and d - full < least:
                least, distance, protective, shape, ball = d - full, d, full, s, o
            if d >= protective_distance(rule, table, scale * fastest, scale * closing, coming):
                continue
            low, high = 0.0, scale
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                kept = d >= protective_distance(rule, table, middle * fastest, middle * closing, coming)
                low, high = (middle, high) if kept else (low, middle)
            scale, distance, protective, shape, ball = low if low > 1e-4 else 0.0, d, full, s, o
    return scale, distance, protective, shape, ball
