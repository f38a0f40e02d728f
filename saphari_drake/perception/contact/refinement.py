"""The compiled search of a contact point over its link's surface, by what several frames of the residual say."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.friction_cone import tangents
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.perception.contact.evidence import touch_cost


@njit(cache=True)
def window_cost(parent, S, R_WL, p_WL, r, weight, link, p_L, n_L, sigma, force, mu, again, F):
    """Return a contact's cost over frames (k, …) and fill F (3,) with the newest frame's force.

    It is the weighted sum of the misfits and the mean spread: once, and the share `again` of it for each further frame,
    as a force that lasts is not chosen anew in each.
    """
    total, spreads, weights = 0.0, 0.0, 0.0
    p, a, H, b = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(3)
    for f in range(r.shape[0]):
        R, o = R_WL[f, link], p_WL[f, link]
        for i in range(3):
            p[i] = o[i] + R[i, 0] * p_L[0] + R[i, 1] * p_L[1] + R[i, 2] * p_L[2]
            a[i] = -(R[i, 0] * n_L[0] + R[i, 1] * n_L[1] + R[i, 2] * n_L[2])
        misfit, spread = touch_cost(parent, S[f], link, p, a, r[f], sigma, force, mu, 0.0, H, b, F)
        total += weight[f] * misfit
        spreads += weight[f] * spread
        weights += weight[f]
    return total + spreads / weights * (1.0 + again * (weights - 1.0))


@njit(cache=True)
def refine(parent, S, R_WL, p_WL, r, weight, kind, size, inner, R_LS, p_LS, own, link, start, normal, anchor,
           anchor_sigma, sigma, force, mu, again, steps):  # fmt: skip
    """Move a contact point over its link's surface to where its cost is least, by a pattern search from `start`.

    Parameters
    ----------
    kind, size, inner, R_LS, p_LS : arrays
        The robot's shapes; `own` (s,) says which belong to the link. Normals are those of the shapes with the sizes
        `inner` (m), grown: where edges are sharp, the force's cone turns over some way.
    start, normal : (3,) arrays
        First point (m) and outward normal, in the link's frame.
    anchor, anchor_sigma : (3,) array, float
        Point that the cameras see (m) and its deviation (m); ∞: they see none.
    steps : (k,) array
        Step sizes of the search (m), from coarse to fine.

    Returns
    -------
    p_L (3,), n_L (3,), cost : the best point, its outward normal, and its cost with that of the anchor.
    """
    F, t, u, trial = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    p, n = start.copy(), normal.copy()
    off = (p[0] - anchor[0]) ** 2 + (p[1] - anchor[1]) ** 2 + (p[2] - anchor[2]) ** 2
    best = window_cost(parent, S, R_WL, p_WL, r, weight, link, p, n, sigma, force, mu, again, F) + off / anchor_sigma**2
    for step in steps:
        for _ in range(2):
            tangents(n, t, u)
            here, moved = p.copy(), False
            for k in range(4):
                side = step if k < 2 else -step
                for i in range(3):
                    trial[i] = here[i] + side * (t[i] if k % 2 == 0 else u[i])
                _, _, q, _ = nearest_surface_point(kind, size, R_LS, p_LS, own, trial)
                _, _, _, m = nearest_surface_point(kind, inner, R_LS, p_LS, own, q)
                cost = window_cost(parent, S, R_WL, p_WL, r, weight, link, q, m, sigma, force, mu, again, F)
                cost += ((q[0] - anchor[0]) ** 2 + (q[1] - anchor[1]) ** 2 + (q[2] - anchor[2]) ** 2) / anchor_sigma**2
                if cost < best:
                    best, p, n, moved = cost, q, m, True
            if not moved:
                break
    return p, n, best


@njit(cache=True)
def refine_all(parent, S, R_WL, p_WL, r, weight, kind, size, inner, R_LS, p_LS, shape_link, links, starts, normals,
               anchors, anchor_sigmas, sigma, force, mu, again, steps):  # fmt: skip
    """Return points (m, 3), normals (m, 3) and costs (m,) of `refine` for m contacts."""
    m = links.shape[0]
    p, n, cost = np.empty((m, 3)), np.empty((m, 3)), np.empty(m)
    for k in range(m):
        p[k], n[k], cost[k] = refine(parent, S, R_WL, p_WL, r, weight, kind, size, inner, R_LS, p_LS,
                                     shape_link == links[k], links[k], starts[k], normals[k], anchors[k],
                                     anchor_sigmas[k], sigma, force, mu, again, steps)  # fmt: skip
    return p, n, cost
