"""Cost of a whole prediction horizon with its derivatives in one compiled pass, eq. (15)–(21).

What is called for every point is inlined, with arrays by name: passing them on costs more than the sums.

The decision variables are the joint positions q_1 … q_N; v_k = (q_{k+1} − q_k)/T_s. The Hessian is block tridiagonal:
its blocks off the diagonal are −2Q_v/T_s² and constant, so that only those on the diagonal are evaluated.

With ω_j the axis of joint j, J_j the column of a point's Jacobian, and i an ancestor of j or j itself, the curvature
of a point is ∂²p/∂q_i∂q_j = ω_i × J_j for a revolute i and 0 for a prismatic one, so that the exact Hessian costs
hardly more than the Gauss–Newton one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.control.nmpc.barrier import MANY, barrier, barrier_sums, pseudo_huber
from saphari_drake.control.nmpc.data import Array
from saphari_drake.control.nmpc.kinematics import compose, empty_frames, forward, jacobian, place, relative_quaternion

# What keeps the Hessian definite across active rows, in multiples of their curvature; see `evaluate`.
STIFFENING = 10.0


class Expansion(NamedTuple):
    """The cost at an iterate, its derivatives, and the test points there."""

    f: float
    g: Array  # (N, n)
    H: Array  # (N, n, n), diagonal blocks
    P: Array  # (N + 1, points, 3), test points in the world at stages 0 … N
    J: Array  # (N + 1, points, n, 3), columns of their Jacobians, in the order of the joints


@njit(cache=True)
def evaluate(data, scene, Q, multipliers, exact, derivatives):
    """Return the `Expansion` of the cost at an iterate.

    Parameters
    ----------
    data : HorizonData
    scene : Scene
    Q : (N, n) array
        Positions of stages 1 … N.
    multipliers : (N + 1, points, m) array
        λ ≥ 0 of the distance rows, whose curvature −λ∇²z is added if `exact`. With d = p − p_O it is, in p,
        −2λ(I − κ ddᵀ/‖d‖²), κ = `STIFFENING`: the part along d is a multiple of ∇z∇zᵀ, which is constant where the row
        is active.
    exact : bool
        Exact Hessian instead of the Gauss–Newton one.
    derivatives : bool
        Whether to evaluate them at all.
    """
    N, n = Q.shape
    points, steps = data.link_C.shape[0], N if derivatives else 0
    g, H = np.zeros((N, n)), np.zeros((steps, n, n))
    P, J = np.empty((N + 1, points, 3)), np.zeros((steps + 1, points, n, 3))
    at, term = empty_frames(n), PointTerm(np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((n, 3)))
    forward(data, scene.q0, at)
    for i in range(points):
        place(at.R[data.link_C[i]], at.p[data.link_C[i]], data.p_MC[i], P[0, i])
    f = 0.0
    for k in range(1, N + 1):
        forward(data, Q[k - 1], at)
        f += _motion_cost(data, scene.q0, Q, k, g, H)
        f += _pose_cost(data, scene, k, at, term, exact, g[k - 1], H[k - 1 : k])
        for i in range(points):
            link, x = data.link_C[i], P[k, i]
            place(at.R[link], at.p[link], data.p_MC[i], x)
            value, bent = _obstacle_cost(data, scene, k, i, x, multipliers, exact, term)
            f += value
            if not derivatives:
                continue
            jacobian(data, at, link, x)
            for a in range(data.depth[link]):
                for r in range(3):
                    J[k, i, data.chain[link, a], r] = at.J[a, r]
            if bent:
                _add_term(data, at, link, term, exact, g[k - 1], H[k - 1])
    for k in range(steps):
        for j in range(n):
            for i in range(j):
                H[k, j, i] = H[k, i, j]
    return Expansion(f, g, H, P, J)


class PointTerm(NamedTuple):
    """A term of the cost, and of the Lagrangian, as a function of one point's position."""

    F: Array  # (3,), gradient of the cost
    G: Array  # (3,), gradient of the Lagrangian
    S: Array  # (3, 3), Hessian of the Lagrangian
    bend: Array  # (n, 3), G × ω, to fill


@njit(cache=True, inline="always")
def _add_term(data, at, link, term, exact, g, H):
    """Add JᵀF to g, and JᵀSJ + Σ G·∂²p to the upper triangle of H if there is one, by ``at.J`` of the point."""
    R, J, (F, G, S, bend), chain, revolute = at.R, at.J, term, data.chain, data.revolute
    for a in range(data.depth[link]):
        j = chain[link, a]
        x, y, z = J[a, 0], J[a, 1], J[a, 2]
        g[j] += F[0] * x + F[1] * y + F[2] * z
        wx, wy, wz = R[j, 0, 2], R[j, 1, 2], R[j, 2, 2]
        turns = 1.0 if exact and revolute[j] else 0.0
        bend[a, 0] = turns * (G[1] * wz - G[2] * wy)
        bend[a, 1] = turns * (G[2] * wx - G[0] * wz)
        bend[a, 2] = turns * (G[0] * wy - G[1] * wx)
        t0 = S[0, 0] * x + S[0, 1] * y + S[0, 2] * z
        t1 = S[1, 0] * x + S[1, 1] * y + S[1, 2] * z
        t2 = S[2, 0] * x + S[2, 1] * y + S[2, 2] * z
        for b in range(a + 1):
            curved = bend[b, 0] * x + bend[b, 1] * y + bend[b, 2] * z
            H[chain[link, b], j] += t0 * J[b, 0] + t1 * J[b, 1] + t2 * J[b, 2] + curved


@njit(cache=True, inline="always")
def _motion_cost(data, q0, Q, k, g, H):
    """Add the terms (15), (16) of stage k: (q_k − q_{k−1})ᵀQ_v(…)/T_s² and (q_k − h)ᵀQ_q(…), or R_q at the last."""
    last = k == Q.shape[0]
    Q_q, Q_v, home, rate, f = data.R_q if last else data.Q_q, data.Q_v, data.home, 1.0 / data.period**2, 0.0
    for j in range(Q.shape[1]):
        v = Q_v[j] * rate
        step = Q[k - 1, j] - (Q[k - 2, j] if k > 1 else q0[j])
        off = Q[k - 1, j] - home[j]
        f += v * step * step + Q_q[j] * off * off
        g[k - 1, j] += 2.0 * v * step + 2.0 * Q_q[j] * off
        if k > 1:
            g[k - 2, j] -= 2.0 * v * step
        if H.shape[0] > 0:
            H[k - 1, j, j] += (2.0 if last else 4.0) * v + 2.0 * Q_q[j]
    return f


@njit(cache=True, inline="always")
def _obstacle_cost(data, scene, k, i, p, multipliers, exact, term):
    """Fill the term of point i at p: Σ c_i/(d² − d_min²), (20), and −λ(d² − d_min²); return its cost, and if it bends.

    In Gauss–Newton form the Hessian leaves out what the slope of the barrier makes negative.
    """
    F, G, S, _ = term
    for r in range(3):
        F[r] = G[r] = S[r, 0] = S[r, 1] = S[r, 2] = 0.0
    p_WO, radius, cost_on, d_min, guard = scene.p_WO, scene.radius, data.cost_on, data.d_min[i], data.guard
    bent, slope, value = cost_on, 0.0, 0.0
    c = data.c[i] * (data.r_O if k == p_WO.shape[0] - 1 else 1.0)
    if cost_on and radius.shape[0] >= MANY and not (exact and np.any(multipliers[k, i] > 0.0)):
        sums = np.zeros(11)
        if barrier_sums(p_WO[k], radius, p, d_min, guard, sums) == 0.0:
            for r in range(3):
                F[r] = G[r] = -2.0 * c * sums[2 + r]
            S[0, 0], S[1, 1], S[2, 2] = 8.0 * c * sums[5], 8.0 * c * sums[6], 8.0 * c * sums[7]
            S[0, 1] = S[1, 0] = 8.0 * c * sums[8]
            S[0, 2] = S[2, 0] = 8.0 * c * sums[9]
            S[1, 2] = S[2, 1] = 8.0 * c * sums[10]
            if exact:
                for r in range(3):
                    S[r, r] -= 2.0 * c * sums[1]
            return c * sums[0], True
    for o in range(radius.shape[0]):
        lam = 2.0 * multipliers[k, i, o] if exact else 0.0
        if not cost_on and lam == 0.0:
            continue
        x, y, z = p[0] - p_WO[k, 0, o], p[1] - p_WO[k, 1, o], p[2] - p_WO[k, 2, o]
        d2, kept, u, v = x * x + y * y + z * z, d_min + radius[o], 0.0, 0.0
        if cost_on:
            psi, psi1, psi2 = barrier(d2 - kept * kept, guard)
            value += c * psi
            u, v = 2.0 * c * psi1, 4.0 * c * psi2
        bent, w = True, u - lam
        if lam > 0.0:
            v += STIFFENING * lam / d2
        slope += w
        F[0] += u * x
        F[1] += u * y
        F[2] += u * z
        G[0] += w * x
        G[1] += w * y
        G[2] += w * z
        S[0, 0] += v * x * x
        S[0, 1] += v * x * y
        S[0, 2] += v * x * z
        S[1, 1] += v * y * y
        S[1, 2] += v * y * z
        S[2, 2] += v * z * z
    S[1, 0], S[2, 0], S[2, 1] = S[0, 1], S[0, 2], S[1, 2]
    if exact:
        for r in range(3):
            S[r, r] += slope
    return value, bent


@njit(cache=True, inline="always")
def _pose_cost(data, scene, k, at, term, exact, g, H):
    """Add eᵀQ_e e, (17), with e the position error and twice the vector part of the quaternion of R_refᵀR."""
    F, G, S, _ = term
    link, R_ref = data.link_E, scene.R_ref[k]
    Q = data.R_e if k == scene.p_ref.shape[0] - 1 else data.Q_e
    x, off, eps, R_WE = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    place(at.R[link], at.p[link], data.p_ME, x)
    compose(at.R[link], data.R_ME, R_WE)
    eta = relative_quaternion(R_ref, R_WE, eps)
    away = turned = 0.0
    for r in range(3):
        off[r] = x[r] - scene.p_ref[k, r]
        away += Q[r] * off[r] * off[r]
        turned += 4.0 * Q[3 + r] * eps[r] * eps[r]
    value, slope, curve = pseudo_huber(away, data.pull[0] * (Q[0] + Q[1] + Q[2]))
    turn = pseudo_huber(turned, data.pull[1] * (Q[3] + Q[4] + Q[5]))
    for r in range(3):
        F[r] = G[r] = 2.0 * slope * Q[r] * off[r]
        for c in range(3):
            S[r, c] = 4.0 * curve * Q[r] * off[r] * Q[c] * off[c]
        S[r, r] += 2.0 * slope * Q[r]
    if H.shape[0] > 0:
        jacobian(data, at, link, x)
        _add_term(data, at, link, term, exact, g, H[0])
        _add_turn(data, at, R_ref, Q[3:], (eta, eps), turn, exact, g, H[0])
    return value + turn[0]


@njit(cache=True, inline="always")
def _add_turn(data, at, R_ref, Q, quaternion, turn, exact, g, H):
    """Add gradient and Hessian of φ(4 εᵀQε): with a_j = R_refᵀω_j, ∂ε = ½(η a + a × ε) and ∂η = −½ a·ε."""
    n, link, R, (eta, eps), (_, slope, curve) = g.shape[0], data.link_E, at.R, quaternion, turn
    a, E, bend, along, We = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n), 4.0 * Q * eps
    for c in range(data.depth[link]):
        j = data.chain[link, c]
        if not data.revolute[j]:
            continue
        for r in range(3):
            a[c, r] = R_ref[0, r] * R[j, 0, 2] + R_ref[1, r] * R[j, 1, 2] + R_ref[2, r] * R[j, 2, 2]
        x, y, z = a[c, 0], a[c, 1], a[c, 2]
        E[c, 0] = 0.5 * (eta * x + y * eps[2] - z * eps[1])
        E[c, 1] = 0.5 * (eta * y + z * eps[0] - x * eps[2])
        E[c, 2] = 0.5 * (eta * z + x * eps[1] - y * eps[0])
        bend[c, 0], bend[c, 1], bend[c, 2] = We[1] * z - We[2] * y, We[2] * x - We[0] * z, We[0] * y - We[1] * x
        d_eta = -0.5 * (x * eps[0] + y * eps[1] + z * eps[2])
        along[c] = 2.0 * (We[0] * E[c, 0] + We[1] * E[c, 1] + We[2] * E[c, 2])
        g[j] += slope * along[c]
        for b in range(c + 1):
            h = 0.0
            for r in range(3):
                h += 8.0 * Q[r] * E[c, r] * E[b, r]
                if exact:
                    h += bend[b, r] * E[c, r] + d_eta * We[r] * a[b, r]
            H[data.chain[link, b], j] += slope * h + curve * along[b] * along[c]
