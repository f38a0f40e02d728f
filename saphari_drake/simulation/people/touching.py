"""Contact of a person's capsules with a robot: elastic, and each segment gives way by itself; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import surface_point_local
from saphari_drake.safety.nearness import pair, posed

Array = NDArray[np.float64]
_CUTS = 20  # each to two thirds


class Flesh(NamedTuple):
    """What the segments are made of, all (k,)."""

    radius: Array  # m
    stiffness: Array  # N/m, of the contact
    mass: Array  # kg, that moves with it
    hold: Array  # N/m, with which the person keeps the segment where it should be
    damping: Array  # Ns/m
    dissipation: float  # s/m, of the contact (Hunt–Crossley)


class Touches(NamedTuple):
    """Contacts, one a segment."""

    force: Array  # (k, 3) N, on the robot, world
    point: Array  # (k, 3) m
    link: NDArray[np.int64]  # (k,) −1: none
    gap: Array  # (k,) m, of the segment from the robot, negative in contact


@njit(cache=True)
def _distance(surface, poses, s, a, b, share, work):
    """Return the distance (m) of shape s from a point of the line from a to b; `work` (4, 3) is overwritten."""
    offset, local = work[0], work[1]
    for i in range(3):
        offset[i] = a[i] + share * (b[i] - a[i]) - poses[1][s, i]
    for i in range(3):
        R = poses[0][s]
        local[i] = R[0, i] * offset[0] + R[1, i] * offset[1] + R[2, i] * offset[2]
    return surface_point_local(surface.kind[s], surface.size[s], local, work[2], work[3])


@njit(cache=True)
def nearest_on_segment(surface, poses, s, a, b, p):
    """Fill p (3,) with the point of the line from a to b that is nearest to shape s; return its share of the way."""
    low, high, work = 0.0, 1.0, np.empty((4, 3))
    if (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2 < 1e-12:
        p[:] = a
        return 0.0
    for _ in range(_CUTS):  # the distance from a convex shape is convex along the line
        one, two = low + (high - low) / 3.0, high - (high - low) / 3.0
        if _distance(surface, poses, s, a, b, one, work) <= _distance(surface, poses, s, a, b, two, work):
            high = two
        else:
            low = one
    share = 0.5 * (low + high)
    p[:] = a + share * (b - a)
    return share


@njit(cache=True)
def touches(surface, motion, ends, velocities, flesh):
    """Return the contact of each segment with the shape that it is deepest in: f = k δ (1 + d δ̇) ≥ 0, no friction.

    Parameters
    ----------
    surface : Surface
    motion : TreeMotion
    ends, velocities : (k, 2, 3) arrays
        Of the segments' ends, in the world (m, m/s).
    flesh : Flesh
    """
    count, shapes = ends.shape[0], surface.link.shape[0]
    force, point = np.zeros((count, 3)), np.zeros((count, 3))
    link, gaps = np.full(count, -1), np.full(count, np.inf)
    poses, p, work, bound = posed(surface, motion), np.empty(3), np.empty((4, 3)), np.empty(shapes)
    for k in range(count):
        a, b = ends[k, 0], ends[k, 1]
        middle, half = 0.5 * (a + b), 0.5 * np.sqrt(np.sum((b - a) ** 2))
        for s in range(shapes):
            bound[s] = _distance(surface, poses, s, middle, middle, 0.0, work) - half - flesh.radius[k]
        for _ in range(shapes):  # the nearest first, so that most others are out of the question
            s = int(np.argmin(bound))
            if bound[s] > min(gaps[k], 0.5):
                break
            bound[s] = np.inf
            share = nearest_on_segment(surface, poses, s, a, b, p)
            away, p_WN, u = pair(surface, poses, s, p)
            gap = away - flesh.radius[k]
            if gap >= gaps[k]:
                continue
            gaps[k] = gap
            if gap >= 0.0:
                continue
            V = motion.V[surface.link[s]]
            v = np.array([
                V[3] + V[1] * p_WN[2] - V[2] * p_WN[1],
                V[4] + V[2] * p_WN[0] - V[0] * p_WN[2],
                V[5] + V[0] * p_WN[1] - V[1] * p_WN[0],
            ])  # fmt: skip
            person = velocities[k, 0] + share * (velocities[k, 1] - velocities[k, 0])
            deeper = np.sum(u * (v - person))
            size = max(-flesh.stiffness[k] * gap * (1.0 + flesh.dissipation * deeper), 0.0)
            force[k], point[k], link[k] = -size * u, p_WN, surface.link[s]
    return force, point, link, gaps


@njit(cache=True)
def given_way(x, v, force, rest, flesh, dt):
    """Advance how far and how fast segments are pushed aside, x and v (k, 3), under their forces on the robot (k, 3).

    m ẍ = −K (x − rest) − D ẋ − f, semi-implicit in time.
    """
    for k in range(x.shape[0]):
        push = flesh.hold[k] * (rest[k] - x[k]) - force[k]
        v[k] = (v[k] + dt * push / flesh.mass[k]) / (1.0 + dt * flesh.damping[k] / flesh.mass[k])
        x[k] += dt * v[k]
