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

import numpy as np

from saphari_drake.compiled import njit

# Products are written out: numba's own call BLAS through SciPy, and are slower at this size.

REVOLUTE = 0
PRISMATIC = 1


@njit(cache=True)
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


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
    a = np.empty(3)
    _cross(V[:3], S[:3], out[:3])
    _cross(V[:3], S[3:], out[3:])
    _cross(V[3:], S[:3], a)
    out[3:] += a


@njit(cache=True)
def _force_cross(V, F, out):
    """Return V ×* F of a motion and a force vector, [ω×n + v×f; ω×f]."""
    a = np.empty(3)
    _cross(V[:3], F[:3], out[:3])
    _cross(V[3:], F[3:], a)
    out[:3] += a
    _cross(V[:3], F[3:], out[3:])


@njit(cache=True)
def _inertia_times(m, mc, I_O, V, out):
    """Momentum of a body with mass m, first moment mc and inertia I_O about the world origin."""
    a = np.empty(3)
    for i in range(3):
        out[i] = I_O[i, 0] * V[0] + I_O[i, 1] * V[1] + I_O[i, 2] * V[2]
    _cross(mc, V[3:], a)
    out[:3] += a
    _cross(V[:3], mc, out[3:])
    for i in range(3):
        out[3 + i] += m * V[3 + i]


@njit(cache=True)
def tree_kinematics(parent, kind, axis, R_PF, p_PF, R_ML, p_ML, q, v):
    """Return poses, joint axes, velocities and velocity-product accelerations of all links.

    Parameters
    ----------
    parent : (n,) int array
        Link that carries joint j (−1 for the world); link j is the one that joint j moves, parents first.
    kind : (n,) int array
        REVOLUTE or PRISMATIC.
    axis : (n, 3) array
        Joint axis in the joint's frame F on the parent.
    R_PF, p_PF, R_ML, p_ML : arrays
        Fixed poses: F in the parent link, and link L in the joint's moving frame M.
    q, v : (n,) array
        Joint positions and velocities (rad or m, rad/s or m/s).

    Returns
    -------
    R_WL (n,3,3), p_WL (n,3), S (n,6), V (n,6), A (n,6)
        Link poses; joint axes, link velocities and link accelerations for q̈ = 0 (spatial, at the world origin).
    """
    n = q.shape[0]
    R_WL = np.empty((n, 3, 3))
    p_WL = np.empty((n, 3))
    S = np.zeros((n, 6))
    V = np.zeros((n, 6))
    A = np.zeros((n, 6))
    VxS = np.empty(6)
    R_FM, R_WF, R_WM = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    p_WF, moved, a = np.empty(3), np.empty(3), np.empty(3)
    for j in range(n):
        k = parent[j]
        if k < 0:
            R_WF[:] = R_PF[j]
            p_WF[:] = p_PF[j]
        else:
            _times(R_WL[k], R_PF[j], R_WF)
            _apply(R_WL[k], p_PF[j], p_WF)
            p_WF += p_WL[k]
        u = axis[j]
        _apply(R_WF, u, a)
        if kind[j] == REVOLUTE:
            s, c = np.sin(q[j]), np.cos(q[j])
            for i in range(3):
                for l in range(3):
                    R_FM[i, l] = (1.0 - c) * u[i] * u[l]
                R_FM[i, i] += c
            R_FM[0, 1] -= s * u[2]
            R_FM[0, 2] += s * u[1]
            R_FM[1, 0] += s * u[2]
            R_FM[1, 2] -= s * u[0]
            R_FM[2, 0] -= s * u[1]
            R_FM[2, 1] += s * u[0]
            _times(R_WF, R_FM, R_WM)
            S[j, :3] = a
            _cross(p_WF, a, S[j, 3:])
        else:
            R_WM[:] = R_WF
            p_WF += q[j] * a
            S[j, 3:] = a
        _times(R_WM, R_ML[j], R_WL[j])
        _apply(R_WM, p_ML[j], moved)
        p_WL[j] = p_WF + moved
        if k >= 0:
            V[j] = V[k]
            A[j] = A[k]
        _motion_cross(V[j], S[j], VxS)
        for i in range(6):
            A[j, i] += VxS[i] * v[j]
            V[j, i] += S[j, i] * v[j]
    return R_WL, p_WL, S, V, A


@njit(cache=True)
def tree_dynamics(parent, mass, com, inertia, armature, gravity, R_WL, p_WL, S, V, A, v):
    """Return M, Cq̇, Cᵀq̇, g and p of a tree whose kinematics are known.

    Parameters
    ----------
    mass (n,), com (n,3), inertia (n,3,3) : arrays
        Of each link (kg, m, kg m²), in the link frame, inertia about the centre of mass.
    armature : (n,) array
        Reflected rotor inertia added to M's diagonal.
    gravity : (3,) array
        Gravity vector in the world (m/s²).

    Returns
    -------
    M (n,n), Cv (n,), CTv (n,), g (n,), p (n,)
    """
    n = v.shape[0]
    m = mass.copy()
    mc = np.empty((n, 3))
    I_O = np.empty((n, 3, 3))
    H = np.empty((n, 6))
    F = np.empty((n, 6))
    a6 = np.empty(6)
    c = np.empty(3)
    RI, I = np.empty((3, 3)), np.empty((3, 3))
    for j in range(n):
        _apply(R_WL[j], com[j], c)
        c += p_WL[j]
        _times(R_WL[j], inertia[j], RI)
        _times(RI, R_WL[j].T, I)
        cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
        for a in range(3):
            mc[j, a] = m[j] * c[a]
            for b in range(3):
                I_O[j, a, b] = I[a, b] - m[j] * c[a] * c[b]
            I_O[j, a, a] += m[j] * cc
        _inertia_times(m[j], mc[j], I_O[j], V[j], H[j])
        _inertia_times(m[j], mc[j], I_O[j], A[j], F[j])
        _force_cross(V[j], H[j], a6)
        F[j] += a6
    M = np.zeros((n, n))
    Cv = np.empty(n)
    CTv = np.empty(n)
    g = np.empty(n)
    p = np.empty(n)
    VxS = np.empty(6)
    Ic = np.empty(6)
    moment = np.empty(3)
    for j in range(n - 1, -1, -1):
        k = parent[j]
        p[j] = _dot(S[j], H[j]) + armature[j] * v[j]
        Cv[j] = _dot(S[j], F[j])
        if k >= 0:
            _motion_cross(V[k], S[j], VxS)
            CTv[j] = _dot(VxS, H[j])
        else:
            CTv[j] = 0.0
        _cross(mc[j], gravity, moment)
        g[j] = -(_dot(S[j, :3], moment) + m[j] * _dot(S[j, 3:], gravity))
        _inertia_times(m[j], mc[j], I_O[j], S[j], Ic)
        i = j
        while i >= 0:
            M[i, j] = _dot(S[i], Ic)
            M[j, i] = M[i, j]
            i = parent[i]
        M[j, j] += armature[j]
        if k >= 0:
            m[k] += m[j]
            mc[k] += mc[j]
            I_O[k] += I_O[j]
            H[k] += H[j]
            F[k] += F[j]
    return M, Cv, CTv, g, p


@njit(cache=True)
def point_kinematics(parent, S, V, A, R_WL, p_WL, link, p_LC):
    """Return position, velocity, Jacobian and J̇q̇ of a point fixed in a link.

    Parameters
    ----------
    link : int
        Index of the link.
    p_LC : (3,) array
        The point in the link frame (m).

    Returns
    -------
    p_WC (3,), v_WC (3,), Jv_WC (3,n), Jdotv_WC (3,)
        In the world frame; ``v_WC = Jv_WC @ v`` and ``dv_WC/dt = Jv_WC @ vdot + Jdotv_WC``.
    """
    n = S.shape[0]
    J = np.zeros((3, n))
    a = np.empty(3)
    p_WC = np.empty(3)
    _apply(R_WL[link], p_LC, p_WC)
    p_WC += p_WL[link]
    j = link
    while j >= 0:
        _cross(S[j, :3], p_WC, a)
        for i in range(3):
            J[i, j] = S[j, 3 + i] + a[i]
        j = parent[j]
    v_WC = np.empty(3)
    _cross(V[link, :3], p_WC, v_WC)
    v_WC += V[link, 3:]
    Jdotv = np.empty(3)
    _cross(A[link, :3], p_WC, Jdotv)
    _cross(V[link, :3], v_WC, a)
    Jdotv += A[link, 3:] + a
    return p_WC, v_WC, J, Jdotv
