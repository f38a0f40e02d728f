"""Joint frames and points of a robot, and its motion within one control period, for compiled kernels.

Every joint turns about, or moves along, the z axis of its own frame M; fixed rotations are folded into the constants.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit

Array = NDArray[np.float64]


class Frames(NamedTuple):
    """Joint frames M in the world, and the Jacobian of one point."""

    R: Array  # (n, 3, 3)
    p: Array  # (n, 3)
    J: Array  # (n, 3), columns, in the order of the joints that move the point


@njit(cache=True)
def empty_frames(n):
    """Return `Frames` of n joints to fill."""
    return Frames(np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3)))


@njit(cache=True)
def dot(a, b):
    """Inner product of two (3,) arrays."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, inline="always")
def compose(A, B, out):
    """Write A B of (3, 3) arrays."""
    for r in range(3):
        for s in range(3):
            out[r, s] = A[r, 0] * B[0, s] + A[r, 1] * B[1, s] + A[r, 2] * B[2, s]


@njit(cache=True, inline="always")
def place(R, p, x, out):
    """Write R x + p."""
    for r in range(3):
        out[r] = p[r] + R[r, 0] * x[0] + R[r, 1] * x[1] + R[r, 2] * x[2]


@njit(cache=True, inline="always")
def forward(data, q, at):
    """Fill the poses of the joint frames at positions q (n,)."""
    R, p, R_PM, p_PM, parent, revolute = at.R, at.p, data.R_PM, data.p_PM, data.parent, data.revolute
    for j in range(q.shape[0]):
        k = parent[j]
        for r in range(3):
            if k < 0:
                x, y, z = R_PM[j, r, 0], R_PM[j, r, 1], R_PM[j, r, 2]
                p[j, r] = p_PM[j, r]
            else:
                e0, e1, e2 = R[k, r, 0], R[k, r, 1], R[k, r, 2]
                x = e0 * R_PM[j, 0, 0] + e1 * R_PM[j, 1, 0] + e2 * R_PM[j, 2, 0]
                y = e0 * R_PM[j, 0, 1] + e1 * R_PM[j, 1, 1] + e2 * R_PM[j, 2, 1]
                z = e0 * R_PM[j, 0, 2] + e1 * R_PM[j, 1, 2] + e2 * R_PM[j, 2, 2]
                p[j, r] = p[k, r] + e0 * p_PM[j, 0] + e1 * p_PM[j, 1] + e2 * p_PM[j, 2]
            R[j, r, 0], R[j, r, 1], R[j, r, 2] = x, y, z
        if revolute[j]:
            s, c = np.sin(q[j]), np.cos(q[j])
            for r in range(3):
                x, y = R[j, r, 0], R[j, r, 1]
                R[j, r, 0], R[j, r, 1] = c * x + s * y, c * y - s * x
        else:
            for r in range(3):
                p[j, r] += q[j] * R[j, r, 2]


@njit(cache=True, inline="always")
def jacobian(data, at, link, x):
    """Fill the columns of the Jacobian of point `x` (world) of a link."""
    (R, p, J), chain, revolute = at, data.chain, data.revolute
    for a in range(data.depth[link]):
        j = chain[link, a]
        wx, wy, wz = R[j, 0, 2], R[j, 1, 2], R[j, 2, 2]
        if revolute[j]:
            dx, dy, dz = x[0] - p[j, 0], x[1] - p[j, 1], x[2] - p[j, 2]
            J[a, 0], J[a, 1], J[a, 2] = wy * dz - wz * dy, wz * dx - wx * dz, wx * dy - wy * dx
        else:
            J[a, 0], J[a, 1], J[a, 2] = wx, wy, wz


@njit(cache=True)
def relative_quaternion(R_ref, R, e):
    """Write the vector part of the quaternion of R_refᵀR into `e` and return its scalar part, which is ≥ 0."""
    D = np.empty((3, 3))
    compose(R_ref.T, R, D)
    trace = D[0, 0] + D[1, 1] + D[2, 2]
    if trace > -0.5:
        w = 0.5 * np.sqrt(1.0 + trace)
        f = 0.25 / w
        e[0], e[1], e[2] = f * (D[2, 1] - D[1, 2]), f * (D[0, 2] - D[2, 0]), f * (D[1, 0] - D[0, 1])
        return w
    i = 0
    if D[1, 1] > D[0, 0]:
        i = 1
    if D[2, 2] > D[i, i]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    e[i] = 0.5 * np.sqrt(max(1.0 + D[i, i] - D[j, j] - D[k, k], 0.0))
    f = 0.25 / e[i]
    e[j], e[k] = f * (D[j, i] + D[i, j]), f * (D[k, i] + D[i, k])
    w = f * (D[k, j] - D[j, k])
    if w < 0.0:
        w = -w
        for r in range(3):
            e[r] = -e[r]
    return w


@njit(cache=True)
def _sinc(half):
    return 1.0 - half * half / 6.0 if abs(half) < 1e-3 else np.sin(half) / half


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
        chord = time * u[x] * _sinc(half)
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
        u[x], u[y] = chord / time / _sinc(half), 0.0
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
def ramped(u_before, u, ramp, time):
    """Return the command (n,) a `time` (s) after it began to go from `u_before` to u, which takes `ramp` (s)."""
    return u if time >= ramp else u_before + (time / ramp) * (u - u_before)


@njit(cache=True)
def ramp_mean(u_before, u, ramp, time):
    """Return the mean of `ramped` (n,) from the beginning to `time` (s)."""
    left = 1.0 - 0.5 * time / ramp if time < ramp else (0.5 * ramp / time if time > 0.0 else 0.0)
    return u + left * (u_before - u)


@njit(cache=True)
def motion_clearance(data, q, u_before, u, ramp, p_WO, v_WO, radius, extra, times):
    """Return the smallest distance (m) beyond ``d_min − extra`` that any point has from any obstacle at `times` (s).

    Parameters
    ----------
    u_before, u, ramp : (n,) arrays and float
        Commands, see `ramped` and `advance`.
    p_WO, v_WO, radius : (m, 3), (m, 3) and (m,) arrays
        Obstacles at time 0.
    extra : float
        Part of ``data.d_min`` (m) that is not counted.
    """
    at, x = empty_frames(q.shape[0]), np.empty(3)
    smallest = np.inf
    for time in times:
        forward(data, advance(data, q, ramp_mean(u_before, u, ramp, time), time), at)
        for i in range(data.link_C.shape[0]):
            place(at.R[data.link_C[i]], at.p[data.link_C[i]], data.p_MC[i], x)
            for o in range(radius.shape[0]):
                d2 = 0.0
                for r in range(3):
                    d2 += (x[r] - p_WO[o, r] - time * v_WO[o, r]) ** 2
                smallest = min(smallest, np.sqrt(d2) - data.d_min[i] + extra - radius[o])
    return smallest
