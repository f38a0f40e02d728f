"""Cost, gradient, Hessian and distance rows of a whole prediction horizon in one compiled pass, eq. (15)–(22).

The decision variables are the joint positions q_1 … q_N; v_k = (q_{k+1} − q_k)/T_s. The Hessian is block tridiagonal:
its blocks off the diagonal are −2Q_v/T_s² and constant, so that only those on the diagonal are evaluated.

Every joint turns about, or moves along, the z axis of its own frame M; fixed rotations are folded into the constants.
With ω_j that axis, J_j the column of a point's Jacobian, and i an ancestor of j or j itself, the curvature of a point
is ∂²p/∂q_i∂q_j = ω_i × J_j for a revolute i and 0 for a prismatic one, so that the exact Hessian costs hardly more
than the Gauss–Newton one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit

# A curved path leaves its chord by at most max ‖p̈‖ T_s²/8; ‖p̈‖ is bounded at the end of the interval, and this factor
# covers its change over the interval.
CURVATURE_FACTOR = 1.25
# What keeps the Hessian definite across active rows, in multiples of their curvature; see `evaluate`.
STIFFENING = 10.0
# m; added to the minimum distance with the margin between samples, for what an iteration leaves.
PAD = 1.0e-5


class HorizonData(NamedTuple):
    """Constants of the problem, as the kernels take them; units m, rad, s."""

    revolute: NDArray[np.int64]  # (n,), 1 or 0
    parent: NDArray[np.int64]  # (n,), −1: the world
    chain: NDArray[np.int64]  # (n, n), ancestors of each link and itself, root first
    depth: NDArray[np.int64]  # (n,), how many these are
    R_PM: NDArray[np.float64]  # (n, 3, 3), frame M of a joint at q = 0, in the M of its parent
    p_PM: NDArray[np.float64]  # (n, 3)
    link_E: int  # that carries the end effector
    R_ME: NDArray[np.float64]  # (3, 3)
    p_ME: NDArray[np.float64]  # (3,)
    link_C: NDArray[np.int64]  # (points,), that carry the test points
    p_MC: NDArray[np.float64]  # (points, 3)
    d_min: NDArray[np.float64]  # (points,)
    c: NDArray[np.float64]  # (points,), of (20)
    period: float
    Q_v: NDArray[np.float64]  # (n,)
    Q_q: NDArray[np.float64]  # (n,)
    Q_e: NDArray[np.float64]  # (6,), position, orientation
    R_q: NDArray[np.float64]  # (n,)
    R_e: NDArray[np.float64]  # (6,)
    r_O: float
    home: NDArray[np.float64]  # (n,)
    q_min: NDArray[np.float64]  # (n,)
    q_max: NDArray[np.float64]  # (n,)
    v_max: NDArray[np.float64]  # (n,)
    guard: float  # m²
    cost_on: bool
    rows_on: bool
    swept: bool  # distances of whole intervals instead of their ends
    base: NDArray[np.int64]  # (3,) joints x, y, θ of a platform that cannot slip sideways, or (0,)


class Rows(NamedTuple):
    """Linearised inequalities z + a·δ_{k−1} + b·δ_k ≥ 0, with δ_0 = 0."""

    stage: NDArray[np.int64]  # (rows,), k = 1 … N
    point: NDArray[np.int64]  # (rows,)
    obstacle: NDArray[np.int64]  # (rows,)
    z: NDArray[np.float64]  # (rows,)
    a: NDArray[np.float64]  # (rows, n)
    b: NDArray[np.float64]  # (rows, n)


class Multipliers(NamedTuple):
    """Multipliers λ > 0 of distance rows, for the Hessian of the Lagrangian."""

    stage: NDArray[np.int64]
    point: NDArray[np.int64]
    obstacle: NDArray[np.int64]
    value: NDArray[np.float64]


@njit(cache=True)
def no_multipliers():
    """Return `Multipliers` of no row."""
    none = np.zeros(0, np.int64)
    return Multipliers(none, none, none, np.zeros(0))


@njit(cache=True)
def forward(data, q, R, p):
    """Fill the poses of the joint frames M in the world: `R` (n, 3, 3) and `p` (n, 3)."""
    for j in range(q.shape[0]):
        k = data.parent[j]
        for r in range(3):
            if k < 0:
                x, y, z = data.R_PM[j, r, 0], data.R_PM[j, r, 1], data.R_PM[j, r, 2]
                p[j, r] = data.p_PM[j, r]
            else:
                e0, e1, e2 = R[k, r, 0], R[k, r, 1], R[k, r, 2]
                x = e0 * data.R_PM[j, 0, 0] + e1 * data.R_PM[j, 1, 0] + e2 * data.R_PM[j, 2, 0]
                y = e0 * data.R_PM[j, 0, 1] + e1 * data.R_PM[j, 1, 1] + e2 * data.R_PM[j, 2, 1]
                z = e0 * data.R_PM[j, 0, 2] + e1 * data.R_PM[j, 1, 2] + e2 * data.R_PM[j, 2, 2]
                p[j, r] = p[k, r] + e0 * data.p_PM[j, 0] + e1 * data.p_PM[j, 1] + e2 * data.p_PM[j, 2]
            R[j, r, 0], R[j, r, 1], R[j, r, 2] = x, y, z
        if data.revolute[j]:
            s, c = np.sin(q[j]), np.cos(q[j])
            for r in range(3):
                x, y = R[j, r, 0], R[j, r, 1]
                R[j, r, 0], R[j, r, 1] = c * x + s * y, c * y - s * x
        else:
            for r in range(3):
                p[j, r] += q[j] * R[j, r, 2]


@njit(cache=True)
def place(R, p, x, out):
    """Write R x + p."""
    for r in range(3):
        out[r] = p[r] + R[r, 0] * x[0] + R[r, 1] * x[1] + R[r, 2] * x[2]


@njit(cache=True)
def jacobian(data, R, p, link, x, J):
    """Fill the columns J[a] (3,) of the Jacobian of point `x` (world) of a link, in the order of its chain."""
    for a in range(data.depth[link]):
        j = data.chain[link, a]
        wx, wy, wz = R[j, 0, 2], R[j, 1, 2], R[j, 2, 2]
        if data.revolute[j]:
            dx, dy, dz = x[0] - p[j, 0], x[1] - p[j, 1], x[2] - p[j, 2]
            J[a, 0], J[a, 1], J[a, 2] = wy * dz - wz * dy, wz * dx - wx * dz, wx * dy - wy * dx
        else:
            J[a, 0], J[a, 1], J[a, 2] = wx, wy, wz


@njit(cache=True)
def barrier(s, guard):
    """Return ψ, ψ' and ψ'' of the barrier 1/s, continued below `guard` by its quadratic expansion there."""
    if s >= guard:
        inv = 1.0 / s
        return inv, -inv * inv, 2.0 * inv * inv * inv
    inv = 1.0 / guard
    t = (s - guard) * inv
    return inv * (1.0 - t + t * t), inv * inv * (2.0 * t - 1.0), 2.0 * inv * inv * inv


@njit(cache=True)
def relative_quaternion(R_ref, R, e):
    """Write the vector part of the quaternion of R_refᵀR into `e` and return its scalar part, which is ≥ 0."""
    D = np.empty((3, 3))
    for r in range(3):
        for s in range(3):
            D[r, s] = R_ref[0, r] * R[0, s] + R_ref[1, r] * R[1, s] + R_ref[2, r] * R[2, s]
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
def _add_pose_term(data, k, R, p, R_ref, p_ref, Q_e, exact, g, H, derivatives):
    """Add eᵀQ_e e of the end effector, with e the position error and twice the vector part of R_refᵀR."""
    n = g.shape[0]
    x, eps, We = np.empty(3), np.empty(3), np.empty(3)
    link = data.link_E
    place(R[link], p[link], data.p_ME, x)
    R_WE = np.empty((3, 3))
    for r in range(3):
        for s in range(3):
            R_WE[r, s] = (
                R[link, r, 0] * data.R_ME[0, s] + R[link, r, 1] * data.R_ME[1, s] + R[link, r, 2] * data.R_ME[2, s]
            )
    eta = relative_quaternion(R_ref, R_WE, eps)
    value = 0.0
    F = np.empty(3)
    for r in range(3):
        F[r] = 2.0 * Q_e[r] * (x[r] - p_ref[r])
        value += 0.5 * F[r] * (x[r] - p_ref[r])
        We[r] = 4.0 * Q_e[3 + r] * eps[r]
        value += We[r] * eps[r]
    if not derivatives:
        return value
    J, E, a = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    d_eta, bp, br = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3))
    jacobian(data, R, p, link, x, J)
    for c in range(data.depth[link]):
        j = data.chain[link, c]
        if data.revolute[j]:
            for r in range(3):
                a[c, r] = R_ref[0, r] * R[j, 0, 2] + R_ref[1, r] * R[j, 1, 2] + R_ref[2, r] * R[j, 2, 2]
            ax, ay, az = a[c, 0], a[c, 1], a[c, 2]
            E[c, 0] = 0.5 * (eta * ax + ay * eps[2] - az * eps[1])
            E[c, 1] = 0.5 * (eta * ay + az * eps[0] - ax * eps[2])
            E[c, 2] = 0.5 * (eta * az + ax * eps[1] - ay * eps[0])
            d_eta[c] = -0.5 * (ax * eps[0] + ay * eps[1] + az * eps[2])
            wx, wy, wz = R[j, 0, 2], R[j, 1, 2], R[j, 2, 2]
            bp[c, 0], bp[c, 1], bp[c, 2] = F[1] * wz - F[2] * wy, F[2] * wx - F[0] * wz, F[0] * wy - F[1] * wx
            br[c, 0], br[c, 1], br[c, 2] = We[1] * az - We[2] * ay, We[2] * ax - We[0] * az, We[0] * ay - We[1] * ax
        g[j] += F[0] * J[c, 0] + F[1] * J[c, 1] + F[2] * J[c, 2]
        g[j] += 2.0 * (We[0] * E[c, 0] + We[1] * E[c, 1] + We[2] * E[c, 2])
    for c in range(data.depth[link]):
        j = data.chain[link, c]
        t0, t1, t2 = 2.0 * Q_e[0] * J[c, 0], 2.0 * Q_e[1] * J[c, 1], 2.0 * Q_e[2] * J[c, 2]
        r0, r1, r2 = 8.0 * Q_e[3] * E[c, 0], 8.0 * Q_e[4] * E[c, 1], 8.0 * Q_e[5] * E[c, 2]
        for b in range(c + 1):
            i = data.chain[link, b]
            h = t0 * J[b, 0] + t1 * J[b, 1] + t2 * J[b, 2] + r0 * E[b, 0] + r1 * E[b, 1] + r2 * E[b, 2]
            if exact:
                h += bp[b, 0] * J[c, 0] + bp[b, 1] * J[c, 1] + bp[b, 2] * J[c, 2]
                h += br[b, 0] * E[c, 0] + br[b, 1] * E[c, 1] + br[b, 2] * E[c, 2]
                h += d_eta[c] * (We[0] * a[b, 0] + We[1] * a[b, 1] + We[2] * a[b, 2])
            H[i, j] += h
    return value


@njit(cache=True)
def evaluate(data, q0, Q, R_ref, p_ref, p_WO, radius, multipliers, exact, derivatives):
    """Return cost, gradient, diagonal blocks of the Hessian, and points of the horizon with their Jacobians.

    Parameters
    ----------
    data : HorizonData
    q0 : (n,) array
        Measured positions; Q: (N, n), positions of stages 1 … N.
    R_ref, p_ref : (N + 1, 3, 3) and (N + 1, 3) arrays
        Reference poses of stages 0 … N; the first is not used.
    p_WO, radius : (N + 1, m, 3) and (m,) arrays
        Obstacles at each stage.
    multipliers : Multipliers
        Of distance rows, whose curvature −λ∇²z is added if `exact`. With d = p − p_O it is, in p, −2λ(I − κ ddᵀ/‖d‖²),
        κ = `STIFFENING`: the part along d is a multiple of ∇z∇zᵀ, which is constant where the row is active.
    exact : bool
        Exact Hessian instead of the Gauss–Newton one. derivatives: whether to evaluate derivatives at all.

    Returns
    -------
    f : float
    g : (N, n) array
    H : (N, n, n) array
        Symmetric.
    P : (N + 1, points, 3) array
        Test points in the world at stages 0 … N.
    J : (N + 1, points, n, 3) array
        Columns of their Jacobians, in the order of the joints.
    """
    N, n = Q.shape
    points, m = data.link_C.shape[0], radius.shape[0]
    steps = N if derivatives else 0
    g, H = np.zeros((steps, n)), np.zeros((steps, n, n))
    P = np.empty((N + 1, points, 3))
    J = np.zeros((steps + 1, points, n, 3))
    R, p = np.empty((n, 3, 3)), np.empty((n, 3))
    S, F, columns = np.empty((3, 3)), np.empty(3), np.empty((n, 3))
    bend = np.empty((n, 3))
    forward(data, q0, R, p)
    for i in range(points):
        place(R[data.link_C[i]], p[data.link_C[i]], data.p_MC[i], P[0, i])
    f = 0.0
    rate = 1.0 / data.period**2
    for k in range(1, N + 1):
        q = Q[k - 1]
        last = k == N
        Q_q, Q_e = (data.R_q, data.R_e) if last else (data.Q_q, data.Q_e)
        scale = data.r_O if last else 1.0
        forward(data, q, R, p)
        for j in range(n):
            step = q[j] - (Q[k - 2, j] if k > 1 else q0[j])
            off = q[j] - data.home[j]
            f += data.Q_v[j] * rate * step * step + Q_q[j] * off * off
            if derivatives:
                g[k - 1, j] += 2.0 * data.Q_v[j] * rate * step + 2.0 * Q_q[j] * off
                H[k - 1, j, j] += 2.0 * data.Q_v[j] * rate + 2.0 * Q_q[j]
                if k > 1:
                    g[k - 2, j] -= 2.0 * data.Q_v[j] * rate * step
                    H[k - 2, j, j] += 2.0 * data.Q_v[j] * rate
        row = k - 1 if derivatives else 0
        g_k = g[row] if derivatives else columns[:, 0]
        H_k = H[row] if derivatives else S
        f += _add_pose_term(data, k, R, p, R_ref[k], p_ref[k], Q_e, exact, g_k, H_k, derivatives)
        for i in range(points):
            link = data.link_C[i]
            x = P[k, i]
            place(R[link], p[link], data.p_MC[i], x)
            S[:], F[:] = 0.0, 0.0
            diagonal = 0.0
            if data.cost_on:
                c = scale * data.c[i]
                for o in range(m):
                    dx, dy, dz = x[0] - p_WO[k, o, 0], x[1] - p_WO[k, o, 1], x[2] - p_WO[k, o, 2]
                    d = data.d_min[i] + radius[o]
                    psi, psi1, psi2 = barrier(dx * dx + dy * dy + dz * dz - d * d, data.guard)
                    f += c * psi
                    u, v = 2.0 * c * psi1, 4.0 * c * psi2
                    F[0] += u * dx
                    F[1] += u * dy
                    F[2] += u * dz
                    diagonal += u
                    S[0, 0] += v * dx * dx
                    S[0, 1] += v * dx * dy
                    S[0, 2] += v * dx * dz
                    S[1, 1] += v * dy * dy
                    S[1, 2] += v * dy * dz
                    S[2, 2] += v * dz * dz
            if not derivatives:
                continue
            depth = data.depth[link]
            jacobian(data, R, p, link, x, columns)
            for a in range(depth):
                j = data.chain[link, a]
                g[row, j] += F[0] * columns[a, 0] + F[1] * columns[a, 1] + F[2] * columns[a, 2]
                for r in range(3):
                    J[k, i, j, r] = columns[a, r]
            bent = data.cost_on
            if exact:
                for e in range(multipliers.value.shape[0]):
                    if multipliers.stage[e] == k and multipliers.point[e] == i:
                        bent, o, lam = True, multipliers.obstacle[e], 2.0 * multipliers.value[e]
                        dx, dy, dz = x[0] - p_WO[k, o, 0], x[1] - p_WO[k, o, 1], x[2] - p_WO[k, o, 2]
                        v = STIFFENING * lam / (dx * dx + dy * dy + dz * dz)
                        F[0] -= lam * dx
                        F[1] -= lam * dy
                        F[2] -= lam * dz
                        diagonal -= lam
                        S[0, 0] += v * dx * dx
                        S[0, 1] += v * dx * dy
                        S[0, 2] += v * dx * dz
                        S[1, 1] += v * dy * dy
                        S[1, 2] += v * dy * dz
                        S[2, 2] += v * dz * dz
            if not bent:
                continue
            if exact:
                for r in range(3):
                    S[r, r] += diagonal
            for a in range(depth):
                j = data.chain[link, a]
                wx, wy, wz = R[j, 0, 2], R[j, 1, 2], R[j, 2, 2]
                turns = 1.0 if exact and data.revolute[j] else 0.0
                bend[a, 0] = turns * (F[1] * wz - F[2] * wy)
                bend[a, 1] = turns * (F[2] * wx - F[0] * wz)
                bend[a, 2] = turns * (F[0] * wy - F[1] * wx)
                jx, jy, jz = columns[a, 0], columns[a, 1], columns[a, 2]
                t0 = S[0, 0] * jx + S[0, 1] * jy + S[0, 2] * jz
                t1 = S[0, 1] * jx + S[1, 1] * jy + S[1, 2] * jz
                t2 = S[0, 2] * jx + S[1, 2] * jy + S[2, 2] * jz
                for b in range(a + 1):
                    H[row, data.chain[link, b], j] += (
                        t0 * columns[b, 0]
                        + t1 * columns[b, 1]
                        + t2 * columns[b, 2]
                        + bend[b, 0] * jx
                        + bend[b, 1] * jy
                        + bend[b, 2] * jz
                    )
        if derivatives:
            for j in range(n):
                for i in range(j):
                    H[row, j, i] = H[row, i, j]
    return f, g, H, P, J
