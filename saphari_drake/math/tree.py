"""Kinematics and dynamics of a tree of one-degree-of-freedom joints, in one compiled pass.

All spatial quantities are ``[angular; linear]``, expressed in the world frame, with the linear part taken at the
*world origin*. In these coordinates no transform is needed between bodies, and with S_j the axis of joint j, V_k the
velocity and h_k = I_k V_k the momentum of link k, and H_j the sum of h_k over the links that joint j carries::

    p_j      = S_j · H_j                      generalized momentum,   p = M(q) q̇
    (Cᵀq̇)_j = (V_parent(j) × S_j) · H_j      = ∂T/∂q_j, exact with the Christoffel C of Ṁ = C + Cᵀ
    (Cq̇)_j  = S_j · Σ (I_k A_k + V_k ×* h_k) Newton–Euler with q̈ = 0
    M_ij     = S_i · I_j^c S_j               composite rigid bodies

(after Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5 and 6; the second line after De Luca and Ferrajoli,
ICRA 2009, who need it for the residual).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.rotations import axis_rotation

Array = NDArray[np.float64]

# Products are written out: numba's own call BLAS through SciPy, and are slower at this size.

REVOLUTE = 0
PRISMATIC = 1


class Tree(NamedTuple):
    """Constants of a tree of n joints; link j is the one that joint j moves, and parents come first."""

    parent: NDArray[np.int64]  # (n,) link that carries joint j (−1: the world)
    kind: NDArray[np.int64]  # (n,) REVOLUTE or PRISMATIC
    axis: Array  # (n, 3) joint axis in the joint's frame F on the parent
    R_PF: Array  # (n, 3, 3) and (n, 3), fixed poses: F in the parent link, …
    p_PF: Array
    R_ML: Array  # … and link L in the joint's moving frame M
    p_ML: Array
    mass: Array  # (n,) of each link, kg
    com: Array  # (n, 3) in the link frame, m
    inertia: Array  # (n, 3, 3) about the centre of mass, in the link frame, kg m²
    armature: Array  # (n,) reflected rotor inertia, added to M's diagonal
    gravity: Array  # (3,) in the world, m/s²


class TreeMotion(NamedTuple):
    """Poses and motion of all links at one state, in the world; spatial quantities at the world origin."""

    R_WL: Array  # (n, 3, 3) and (n, 3), poses of the links
    p_WL: Array
    S: Array  # (n, 6) joint axes
    V: Array  # (n, 6) velocities of the links
    A: Array  # (n, 6) their accelerations for q̈ = 0
    parent: NDArray[np.int64]  # (n,) as in `Tree`


@njit(cache=True)
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _add_cross(a, b, out):
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _times(A, B, out):
    """Product of two 3×3 matrices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@njit(cache=True)
def _apply(A, x, out):
    """Product of a 3×3 matrix and a vector."""
    for i in range(3):
        out[i] = A[i, 0] * x[0] + A[i, 1] * x[1] + A[i, 2] * x[2]


@njit(cache=True)
def _dot(a, b):
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@njit(cache=True)
def _motion_cross(V, S, out):
    """Return V × S of two motion vectors, [ω×s_ω; ω×s_v + v×s_ω]."""
    _cross(V[:3], S[:3], out[:3])
    _cross(V[:3], S[3:], out[3:])
    _add_cross(V[3:], S[:3], out[3:])


@njit(cache=True)
def _force_cross(V, F, out):
    """Return V ×* F of a motion and a force vector, [ω×n + v×f; ω×f]."""
    _cross(V[:3], F[:3], out[:3])
    _add_cross(V[3:], F[3:], out[:3])
    _cross(V[:3], F[3:], out[3:])


@njit(cache=True)
def _inertia_times(m, mc, I_O, V, out):
    """Momentum of a body with mass m, first moment mc and inertia I_O about the world origin."""
    _apply(I_O, V[:3], out[:3])
    _add_cross(mc, V[3:], out[:3])
    _cross(V[:3], mc, out[3:])
    for i in range(3):
        out[3 + i] += m * V[3 + i]


@njit(cache=True)
def world_inertia(tree, motion, j, mc, I_O):
    """Fill first moment mc (3,) and inertia I_O (3, 3) of link j, both about the world origin."""
    R, c, RI = motion.R_WL[j], np.empty(3), np.empty((3, 3))
    _apply(R, tree.com[j], c)
    c += motion.p_WL[j]
    _times(R, tree.inertia[j], RI)
    _times(RI, R.T, I_O)
    m, cc = tree.mass[j], _dot(c, c)
    for a in range(3):
        mc[a] = m * c[a]
        for b in range(3):
            I_O[a, b] -= m * c[a] * c[b]
        I_O[a, a] += m * cc


@njit(cache=True)
def tree_kinematics(tree, q, v):
    """Return the `TreeMotion` of a `Tree` at joint positions q and velocities v (n,) (rad or m, rad/s or m/s)."""
    n = q.shape[0]
    R_WL, p_WL = np.empty((n, 3, 3)), np.empty((n, 3))
    S, V, A = np.zeros((n, 6)), np.zeros((n, 6)), np.zeros((n, 6))
    R_WF, R_WM = np.empty((3, 3)), np.empty((3, 3))
    p_WF, a, VxS = np.empty(3), np.empty(3), np.empty(6)
    for j in range(n):
        k = tree.parent[j]
        if k < 0:
            R_WF[:] = tree.R_PF[j]
            p_WF[:] = tree.p_PF[j]
        else:
            _times(R_WL[k], tree.R_PF[j], R_WF)
            _apply(R_WL[k], tree.p_PF[j], p_WF)
            p_WF += p_WL[k]
            V[j] = V[k]
            A[j] = A[k]
        _apply(R_WF, tree.axis[j], a)
        if tree.kind[j] == REVOLUTE:
            _times(R_WF, axis_rotation(tree.axis[j], q[j]), R_WM)
            S[j, :3] = a
            _cross(p_WF, a, S[j, 3:])
        else:
            R_WM[:] = R_WF
            p_WF += q[j] * a
            S[j, 3:] = a
        _times(R_WM, tree.R_ML[j], R_WL[j])
        _apply(R_WM, tree.p_ML[j], p_WL[j])
        p_WL[j] += p_WF
        _motion_cross(V[j], S[j], VxS)
        for i in range(6):
            A[j, i] += VxS[i] * v[j]
            V[j, i] += S[j, i] * v[j]
    return TreeMotion(R_WL, p_WL, S, V, A, tree.parent)


@njit(cache=True)
def tree_dynamics(tree, motion, v):
    """Return M (n, n), Cq̇, Cᵀq̇, g and p (n,) of a `Tree` that moves as `motion`, with joint velocities v (n,)."""
    n = v.shape[0]
    m, mc, I_O = tree.mass.copy(), np.empty((n, 3)), np.empty((n, 3, 3))
    H, F = np.empty((n, 6)), np.empty((n, 6))
    a6, Ic, moment = np.empty(6), np.empty(6), np.empty(3)
    S, V, gravity = motion.S, motion.V, tree.gravity
    for j in range(n):
        world_inertia(tree, motion, j, mc[j], I_O[j])
        _inertia_times(m[j], mc[j], I_O[j], V[j], H[j])
        _inertia_times(m[j], mc[j], I_O[j], motion.A[j], F[j])
        _force_cross(V[j], H[j], a6)
        F[j] += a6
    M = np.zeros((n, n))
    Cv, CTv, g, p = np.empty(n), np.zeros(n), np.empty(n), np.empty(n)
    for j in range(n - 1, -1, -1):
        k = tree.parent[j]
        p[j] = _dot(S[j], H[j]) + tree.armature[j] * v[j]
        Cv[j] = _dot(S[j], F[j])
        _cross(mc[j], gravity, moment)
        g[j] = -(_dot(S[j, :3], moment) + m[j] * _dot(S[j, 3:], gravity))
        _inertia_times(m[j], mc[j], I_O[j], S[j], Ic)
        i = j
        while i >= 0:
            M[i, j] = _dot(S[i], Ic)
            M[j, i] = M[i, j]
            i = tree.parent[i]
        M[j, j] += tree.armature[j]
        if k >= 0:
            _motion_cross(V[k], S[j], a6)
            CTv[j] = _dot(a6, H[j])
            m[k] += m[j]
            mc[k] += mc[j]
            I_O[k] += I_O[j]
            H[k] += H[j]
            F[k] += F[j]
    return M, Cv, CTv, g, p


@njit(cache=True)
def tree_state(tree, q, v):
    """Return all that `tree_kinematics` and `tree_dynamics` do of a state: R_WL, p_WL, S, V, A, M, Cq̇, Cᵀq̇, g, p."""
    motion = tree_kinematics(tree, q, v)
    M, Cv, CTv, g, p = tree_dynamics(tree, motion, v)
    return motion.R_WL, motion.p_WL, motion.S, motion.V, motion.A, M, Cv, CTv, g, p
