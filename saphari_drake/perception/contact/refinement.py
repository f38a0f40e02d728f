"""The compiled search of a contact point over its link's surface, by what several frames of the residual say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.friction_cone import solve3, tangents
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.perception.contact.evidence import touch_cost, work

Array = NDArray[np.float64]

_FLAT = 1.0 / 0.05**2  # 1/m²; keeps a step short where neither residual nor cameras tell
_STRIDE, _HALVED = 0.03, 3  # m, longest step; and how often one that does not help is cut


class Window(NamedTuple):
    """Robot and residual in some frames, oldest first."""

    S: Array  # (k, n, 6) joint axes
    R_WL: Array  # (k, n, 3, 3)
    p_WL: Array  # (k, n, 3) m
    r: Array  # (k, n) Nm
    weight: Array  # (k,)

    def without(self, joint: int) -> Window:
        """Return the frames as if one joint felt nothing."""
        r = self.r.copy()
        r[:, joint] = 0.0
        return self._replace(r=r)


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
def _leaning(parent, window, start, p_L, n_L, model, scratch, t, u):
    """Return the shift (2,) along the tangents t and u of a point that a Gauss–Newton step asks for (m).

    Torque j of a force F changes with a shift δ by F · (ω × δ) = δ · (F × ω): at the forces that explain the frames
    best, the misfit is quadratic in forces and shift, and the forces are eliminated.
    """
    H, _, F = scratch
    link, n = start.link, parent.shape[0]
    N, g = np.zeros((2, 2)), np.zeros(2)
    p, a, T = np.empty(3), np.empty(3), np.empty((2, 3))
    J, D, B, X = np.empty((n, 3)), np.empty((n, 2)), np.empty((3, 3)), np.empty((3, 3))
    for f in range(window.r.shape[0]):
        R, o, S = window.R_WL[f, link], window.p_WL[f, link], window.S[f]
        for i in range(3):
            p[i] = o[i] + R[i, 0] * p_L[0] + R[i, 1] * p_L[1] + R[i, 2] * p_L[2]
            a[i] = -(R[i, 0] * n_L[0] + R[i, 1] * n_L[1] + R[i, 2] * n_L[2])
            T[0, i] = R[i, 0] * t[0] + R[i, 1] * t[1] + R[i, 2] * t[2]
            T[1, i] = R[i, 0] * u[0] + R[i, 1] * u[1] + R[i, 2] * u[2]
        touch_cost(parent, S, link, p, a, window.r[f], model, scratch)
        B[:] = 0.0  # rows: J of both columns of D, and of what the force leaves
        weight, j = window.weight[f], link
        while j >= 0:
            J[j, 0] = S[j, 3] + S[j, 1] * p[2] - S[j, 2] * p[1]
            J[j, 1] = S[j, 4] + S[j, 2] * p[0] - S[j, 0] * p[2]
            J[j, 2] = S[j, 5] + S[j, 0] * p[1] - S[j, 1] * p[0]
            left = window.r[f, j] - J[j, 0] * F[0] - J[j, 1] * F[1] - J[j, 2] * F[2]
            x = F[1] * S[j, 2] - F[2] * S[j, 1]
            y = F[2] * S[j, 0] - F[0] * S[j, 2]
            z = F[0] * S[j, 1] - F[1] * S[j, 0]
            for k in range(2):
                D[j, k] = x * T[k, 0] + y * T[k, 1] + z * T[k, 2]
                g[k] += weight * D[j, k] * left
                for i in range(3):
                    B[k, i] += J[j, i] * D[j, k]
            for k in range(2):
                for l in range(2):
                    N[k, l] += weight * D[j, k] * D[j, l]
            for i in range(3):
                B[2, i] += J[j, i] * left
            j = parent[j]
        for k in range(3):
            solve3(H, B[k], X[k])
        for k in range(2):
            for i in range(3):
                g[k] -= weight * B[k, i] * X[2, i]
                for l in range(2):
                    N[k, l] -= weight * B[k, i] * X[l, i]
    t_ray = t[0] * start.ray[0] + t[1] * start.ray[1] + t[2] * start.ray[2]
    u_ray = u[0] * start.ray[0] + u[1] * start.ray[1] + u[2] * start.ray[2]
    k = 1.0 / start.sigma**2
    for i in range(3):
        away = p_L[i] - start.anchor[i]
        g[0] -= k * away * (t[i] - t_ray * start.ray[i])
        g[1] -= k * away * (u[i] - u_ray * start.ray[i])
    N[0, 0] += k * (1.0 - t_ray * t_ray) + _FLAT
    N[1, 1] += k * (1.0 - u_ray * u_ray) + _FLAT
    N[0, 1] -= k * t_ray * u_ray
    N[1, 0] = N[0, 1]
    det = N[0, 0] * N[1, 1] - N[0, 1] * N[1, 0]
    shift = np.array([N[1, 1] * g[0] - N[0, 1] * g[1], N[0, 0] * g[1] - N[0, 1] * g[0]]) / det
    return shift * min(1.0, _STRIDE / max(np.sqrt(shift[0] ** 2 + shift[1] ** 2), 1e-12))


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
            tangents(n, t, u)
            shift = _leaning(parent, window, start, p, n, model, scratch, t, u)
            here = p.copy()
            for _ in range(_HALVED):
                _, _, q, _ = nearest_surface_point(kind, size, R_LS, p_LS, own, here + shift[0] * t + shift[1] * u)
                _, _, _, m = nearest_surface_point(kind, inner, R_LS, p_LS, own, q)
                cost = window_cost(parent, window, link, q, m, model, again, scratch)
                cost += _apart(q, start)
                if cost < best:
                    best, p, n, moved = cost, q, m, True
                    break
                shift *= 0.3
            if not moved:
                break
    return p, n, best
