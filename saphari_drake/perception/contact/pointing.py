"""Where the limb of which a camera sees a part goes on to: it tells of contacts behind the robot, which no camera sees.

A finger, fist and forearm lie about in a line. The readings of the person nearest to the robot are fitted by a
cylinder, whose axis goes on from the end that lies nearer to the robot; a wrist may bend, so that the farther ahead,
the wider the region. Hands that grip round the robot are not foreseen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.perception.contact.limb import fit_limb
from saphari_drake.perception.contact.places import View

Array = NDArray[np.float64]

_REACH = 0.30  # m; readings so near to the nearest one belong to its limb
_LEAST, _MOST = 12, 200  # readings of a limb, and about so many that are fitted
_LONG, _SLIM = 0.10, 2.5  # m, and radii of a limb, from which length on its axis is known
_FACING = -0.2  # cosine between inward normal and limb; a surface that looks away more cannot be touched from there


class Ray(NamedTuple):
    """A limb's axis in the world, from its end that lies nearer to the robot."""

    end: Array  # (3,) m
    u: Array  # (3,) unit, away from the limb
    length: float  # m, of what is seen of the limb
    radius: float  # m


def limb_rays(view: View) -> tuple[Ray, ...]:
    """Return where the limb points that a camera sees nearest to the robot; nothing if that is not to be seen."""
    points, R_WC, p_WC = view.person.points, view.camera.R_WC, view.camera.p_WC
    points = points[:: len(points) // _MOST + 1]
    shown, end, u, length, radius = limb_ray(view.person.shapes, (points - p_WC) @ R_WC)
    return (Ray(R_WC @ end + p_WC, R_WC @ u, length, radius),) if shown else ()


@njit(cache=True)
def limb_ray(shapes, point):
    """Return whether readings (k, 3) in C show where a limb points, its end (3,), direction (3,), length and radius.

    Parameters
    ----------
    shapes : Primitives
        The robot's, in C.
    """
    k, moving = point.shape[0], shapes.link >= 0
    best, nearest = np.inf, 0
    for i in range(k):
        d = nearest_surface_point(shapes.kind, shapes.size, shapes.R, shapes.p, moving, point[i])[1]
        if d < best:
            best, nearest = d, i
    nothing = (False, np.zeros(3), np.zeros(3), 0.0, 0.0)
    if k < _LEAST:
        return nothing
    near = point[np.sum((point - point[nearest]) ** 2, axis=1) < _REACH * _REACH].copy()
    if near.shape[0] < _LEAST:
        return nothing
    limb = fit_limb(near)
    length = limb.last - limb.first
    if not length > max(_LONG, _SLIM * limb.radius):
        return nothing
    a, b = limb.c + limb.first * limb.u, limb.c + limb.last * limb.u
    gap_a = nearest_surface_point(shapes.kind, shapes.size, shapes.R, shapes.p, moving, a)[1]
    gap_b = nearest_surface_point(shapes.kind, shapes.size, shapes.R, shapes.p, moving, b)[1]
    if gap_a < gap_b:
        return True, a, -limb.u, length, limb.radius
    return True, b, limb.u.copy(), length, limb.radius


@njit(cache=True)
def ray_costs(p, a, end, u, length, radius, sigma, bend, most):
    """Return what a contact at surface points p with inward normals a (m, 3) costs, given where a limb points.

    Ahead of its end the squared distance from the axis in deviations `sigma` + `bend` × way (m); beside it that from
    its surface; at most `most`, as is what looks away from the limb.
    """
    cost = np.empty(p.shape[0])
    for c in range(p.shape[0]):
        x, y, z = p[c, 0] - end[0], p[c, 1] - end[1], p[c, 2] - end[2]
        along = x * u[0] + y * u[1] + z * u[2]
        beside = max(-along - length, 0.0)
        across = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
        facing = a[c, 0] * u[0] + a[c, 1] * u[1] + a[c, 2] * u[2]
        if along > 0.0:
            cost[c] = (across / (sigma + bend * along)) ** 2 if facing > _FACING else most
        else:
            cost[c] = (max(across - radius, 0.0) ** 2 + beside * beside) / sigma**2
        cost[c] = min(cost[c], most)
    return cost
