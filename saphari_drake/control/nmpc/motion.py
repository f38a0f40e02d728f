"""Motion within one control period: platform arcs, and the clearance that is left on the way."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.control.nmpc.horizon import forward, place


@njit(cache=True)
def advance(data, q, u, time):
    """Return the positions after `time` (s) of a constant command u (n,).

    The command is q̇; for a platform that cannot slip its entries x, y, θ are forward speed, 0 and turning rate, and
    the platform goes along the exact arc.
    """
    out = q + time * u
    if data.base.shape[0] == 3:
        x, y, t = data.base[0], data.base[1], data.base[2]
        half = 0.5 * time * u[t]
        chord = time * u[x] * (1.0 - half * half / 6.0 if abs(half) < 1e-3 else np.sin(half) / half)
        out[x] = q[x] + chord * np.cos(q[t] + half)
        out[y] = q[y] + chord * np.sin(q[t] + half)
    return out


@njit(cache=True)
def command_to(data, q, q_next, time):
    """Return the constant command u (n,) that `advance` takes from q to q_next; the inverse of it on its range."""
    u = (q_next - q) / time
    if data.base.shape[0] == 3:
        x, y, t = data.base[0], data.base[1], data.base[2]
        half = 0.5 * (q_next[t] - q[t])
        chord = (q_next[x] - q[x]) * np.cos(q[t] + half) + (q_next[y] - q[y]) * np.sin(q[t] + half)
        u[x] = chord / time / (1.0 - half * half / 6.0 if abs(half) < 1e-3 else np.sin(half) / half)
        u[y] = 0.0
    return u


@njit(cache=True)
def joint_velocity(data, q, u):
    """Return q̇ (n,) of a command at positions q, scaled as a whole into the velocity limits."""
    v = u.copy()
    if data.base.shape[0] == 3:
        x, y, t = data.base[0], data.base[1], data.base[2]
        v[x], v[y] = u[x] * np.cos(q[t]), u[x] * np.sin(q[t])
    scale = 1.0
    for j in range(v.shape[0]):
        if abs(v[j]) > data.v_max[j]:
            scale = min(scale, data.v_max[j] / abs(v[j]))
    return scale * v


@njit(cache=True)
def motion_clearance(data, q, u, p_WO, v_WO, radius, extra, times):
    """Return the smallest distance (m) beyond ``d_min − extra`` that any point has from any obstacle at `times` (s).

    Parameters
    ----------
    u : (n,) array
        Command, see `advance`.
    p_WO, v_WO, radius : (m, 3), (m, 3) and (m,) arrays
        Obstacles at time 0.
    extra : float
        Part of ``data.d_min`` (m) that is not counted.
    """
    n = q.shape[0]
    R, p, x = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty(3)
    smallest = np.inf
    for time in times:
        forward(data, advance(data, q, u, time), R, p)
        for i in range(data.link_C.shape[0]):
            place(R[data.link_C[i]], p[data.link_C[i]], data.p_MC[i], x)
            for o in range(radius.shape[0]):
                d2 = 0.0
                for r in range(3):
                    d2 += (x[r] - p_WO[o, r] - time * v_WO[o, r]) ** 2
                smallest = min(smallest, np.sqrt(d2) - data.d_min[i] + extra - radius[o])
    return smallest
