"""The compiled search of a contact point over its link's surface, by what several frames of the residual say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.friction_cone import tangents
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.perception.contact.evidence import touch_cost, work

Array = NDArray[np.float64]


class Window(NamedTuple):
    """Robot and residual in some frames, oldest first."""

    S: Array  # (k, n, 6) joint axes
    R_WL: Array  # (k, n, 3, 3)
    p_WL: Array  # (k, n, 3) m
    r: Array  # (k, n) Nm
    weight: Array  # (k,)


class Start(NamedTuple):
    """Where the search of a contact starts, in its link's frame."""

    link: int
    p_L: Array  # (3,) m
    n_L: Array  # (3,) outward normal
    anchor: Array  # (3,) m, point that the cameras see
    sigma: float  # m, its deviation; ∞: they see none
    ray: Array  # (3,) unit vector across which alone it is known; zero: in all directions


@njit(cache=True)
def _apart(p, start):
    """Return the squared deviations of a point p (3,) from the anchor."""
    along, total = 0.0, 0.0
    for i in range(3):
        along += (p[i] - start.anchor[i]) * start.ray[i]
        total += (p[i] - start.anchor[i]) ** 2
    return (total - along * along) / start.sigma**2


@njit(cache=True)
def window_cost(parent, window, link, p_L, n_L, model, again, scratch):
    """Return a contact's cost over frames and leave the newest frame's force (N) in the scratch.

    It is the weighted sum of the misfits and the mean spread: once, and the share `again` of it for each further frame,
    as a force that lasts is not chosen anew in each.
    """
    total, spreads, weights = 0.0, 0.0, 0.0
    p, a = np.empty(3), np.empty(3)
    for f in range(window.r.shape[0]):
        R, o = window.R_WL[f, link], window.p_WL[f, link]
        for i in range(3):
            p[i] = o[i] + R[i, 0] * p_L[0] + R[i, 1] * p_L[1] + R[i, 2] * p_L[2]
            a[i] = -(R[i, 0] * n_L[0] + R[i, 1] * n_L[1] + R[i, 2] * n_L[2])
        misfit, spread = touch_cost(parent, window.S[f], link, p, a, window.r[f], model, scratch)
        total += window.weight[f] * misfit
        spreads += window.weight[f] * spread
        weights += window.weight[f]
    return total + spreads / weights * (1.0 + again * (weights - 1.0))


@njit(cache=True)
def refine(parent, window, shapes, inner, start, model, again, steps):
    """Move a contact point over its link's surface to where its cost is least, by a pattern search.

    Parameters
    ----------
    parent : (n,) int array
    window : Window
    shapes : Primitives
        The robot's, in its links.
    inner : (s, 3) array
        Normals are those of the shapes with these sizes (m), grown: where edges are sharp, the force's cone turns over
        some way.
    start : Start
    model : ForceModel
    again : float
        As in `window_cost`.
    steps : (k,) array
        Step sizes of the search (m), from coarse to fine.

    Returns
    -------
    p_L (3,), n_L (3,), cost : the best point, its outward normal, and its cost with that of the anchor.
    """
    kind, size, links, R_LS, p_LS = shapes
    own, link, scratch = links == start.link, start.link, work()
    t, u = np.empty(3), np.empty(3)
    p, n = start.p_L.copy(), start.n_L.copy()
    best = window_cost(parent, window, link, p, n, model, again, scratch)
    best += _apart(p, start)
    for step in steps:
        for _ in range(2):
            tangents(n, t, u)
            here, moved = p.copy(), False
            for k in range(4):
                side = step if k < 2 else -step
                trial = here + side * (t if k % 2 == 0 else u)
                _, _, q, _ = nearest_surface_point(kind, size, R_LS, p_LS, own, trial)
                _, _, _, m = nearest_surface_point(kind, inner, R_LS, p_LS, own, q)
                cost = window_cost(parent, window, link, q, m, model, again, scratch)
                cost += _apart(q, start)
                if cost < best:
                    best, p, n, moved = cost, q, m, True
            if not moved:
                break
    return p, n, best
