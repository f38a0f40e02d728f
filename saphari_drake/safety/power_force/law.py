"""The energy that a contact would have, and the fastest that the regions of the body allow; compiled."""

from typing import NamedTuple

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import surface_point
from saphari_drake.math.products import cholesky, solve_lower
from saphari_drake.safety.nearness import bounding_radius, nearest_possible, pair, posed, towards
from saphari_drake.safety.power_force.parameters import Walls
from saphari_drake.safety.power_force.regions import Limits

_STEP = 0.02  # m, between the points that are looked at behind a person


class Contact(NamedTuple):
    """Result of `contact_scale`."""

    scale: float  # 0 … 1
    energy: float  # J, at the full command, of the pair that comes nearest to its limit; 0: none comes near
    limit: float  # J, of that pair; infinite: none comes near
    mass: float  # kg, effective, of robot and person there
    clamped: bool  # whether the person cannot give way there
    shape: int  # −1: none
    ball: int


class Rule(NamedTuple):
    """What a contact may be, and where, as in `PowerForceParameters`."""

    limits: Limits
    walls: Walls
    reach: float  # m
    gap: float  # m
    thickest: float  # m
    still: float  # m/s


@njit(cache=True)
def effective_mass(L, row):
    """Return (uᵀJ M⁻¹ Jᵀu)⁻¹ (kg) of M = LLᵀ and uᵀJ (n,); infinite where nothing moves along u."""
    x = row.copy()
    solve_lower(L, x, x.shape[0])
    square = np.sum(x * x)
    return 1.0 / square if square > 0.0 else np.inf


@njit(cache=True)
def contact_mass(robot, person, clamped):
    """Return μ = (1/m_H + 1/m_R)⁻¹ (kg), or m_R where the person cannot give way."""
    return robot if clamped else 1.0 / (1.0 / robot + 1.0 / person)


@njit(cache=True)
def permitted_speed(limits, robot, clamped):
    """Return the largest speed (m/s), its energy (J) and μ (kg): v = √(2E/μ), the least over the regions.

    With E = F²/2k it is v = F/√(kμ) of ISO/TS 15066, A.3.5.
    """
    speed, energy, mass = np.inf, np.inf, robot
    for k in range(limits.mass.shape[0]):
        own = contact_mass(robot, limits.mass[k], clamped)
        E = limits.clamped[k] if clamped else limits.free[k]
        v = np.sqrt(2.0 * E / own)
        if v < speed:
            speed, energy, mass = v, E, own
    return speed, energy, mass


@njit(cache=True)
def is_clamped(surface, poses, s, p_WP, u, thickness, rule):
    """Return whether a wall, the floor or another link is behind a person that shape s pushes along u (world).

    Looked for from the nearest point p_WP of the person on, as far as the person is thick and the gap more. The link of
    the shape, and the ones beside it, do not clamp: they are on the robot's side.
    """
    point, end, walls = np.empty(3), thickness + rule.gap, rule.walls
    count = int(end / _STEP) + 1
    for i in range(1, count + 1):
        for k in range(3):
            point[k] = p_WP[k] + u[k] * end * i / count
        for w in range(walls.kind.shape[0]):
            if surface_point(walls.kind[w], walls.size[w], walls.R[w], walls.p[w], point)[0] <= 0.0:
                return True
        for o in range(surface.link.shape[0]):
            if abs(surface.link[o] - surface.link[s]) > 1 and pair(surface, poses, o, point)[0] <= 0.0:
                return True
    return False


@njit(cache=True)
def contact_scale(surface, motion, M, v, people, head, rule):
    """Return the largest share of the joint velocities v (n,) at which no contact would be harder than allowed.

    Pairs are each shape of the robot and each ball of a person within reach that it moves towards. The energy is
    ½ μ v_r² with the effective mass of the robot along the line between them, and the robot's speed alone: a person who
    runs into a standing robot is not its doing.

    Parameters
    ----------
    surface : Surface
    motion : TreeMotion
    M : (n, n) array
    v : (n,) array
    people : Balls
    head : (m,) bool array
        Balls where no contact is allowed.
    rule : Rule
    """
    n, scale, worst = v.shape[0], 1.0, 0.0
    best = (1.0, 0.0, np.inf, np.inf, False, -1, -1)
    L, row = np.empty((n, n)), np.empty(n)
    cholesky(M, L)
    poses = posed(surface, motion)
    for s in range(surface.link.shape[0]):
        around = bounding_radius(surface, s)
        for o in range(people.radius.shape[0]):
            if nearest_possible(poses, s, around, people, o) > rule.reach:
                continue
            away, p_WN, u = pair(surface, poses, s, people.p[o])
            if away - people.radius[o] > rule.reach:
                continue
            towards(motion, surface.link[s], p_WN, u, row)
            closing = np.sum(row * v)
            if closing <= rule.still:
                continue
            robot = effective_mass(L, row)
            if not head[o] and closing <= worst * permitted_speed(rule.limits, robot, True)[0]:
                continue  # no worse than another, clamped or not
            p_WP = p_WN + max(away - people.radius[o], 0.0) * u  # of the person, nearest to the robot
            clamped = is_clamped(surface, poses, s, p_WP, u, min(2.0 * people.radius[o], rule.thickest), rule)
            speed, limit, mass = permitted_speed(rule.limits, robot, clamped)
            if head[o]:
                speed, limit = 0.0, 0.0
            share = closing / speed if speed > 0.0 else np.inf
            if share > worst:
                worst, scale = share, min(1.0, 1.0 / share)
                best = (scale, 0.5 * mass * closing * closing, limit, mass, clamped, s, o)
    return best


@njit(cache=True)
def heads(p, radius, height, width):
    """Return which balls (m,) belong to the top `height` (m) of the person that they are part of.

    Balls within `width` (m) of one another, horizontally, are the same person's. A raised hand counts as head too.
    """
    count = p.shape[0]
    found = np.zeros(count, dtype=np.bool_)
    if height == 0.0:
        return found
    for i in range(count):
        highest = -np.inf
        for j in range(count):
            if (p[i, 0] - p[j, 0]) ** 2 + (p[i, 1] - p[j, 1]) ** 2 <= width * width:
                highest = max(highest, p[j, 2] + radius[j])
        found[i] = p[i, 2] + radius[i] > highest - height
    return found
