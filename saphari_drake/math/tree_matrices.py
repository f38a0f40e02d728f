"""Points, Jacobians and their time derivatives, and C(q, q̇) as a matrix, of a tree whose motion is known.

Conventions as in `saphari_drake.math.tree`: spatial quantities are ``[angular; linear]`` at the world origin.
C is the one of the Christoffel symbols, so that Ṁ = C + Cᵀ, computed in one pass over the tree (Echeandia and Wensing,
Numerical Methods to Compute the Coriolis Matrix and Christoffel Symbols for Rigid-Body Systems, 2021).
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply, product
from saphari_drake.math.rotations import skew
from saphari_drake.math.tree import world_inertia


@njit(cache=True)
def world_point(motion, link, p_LC):
    """Return the position (3,) in the world of a point of a link; link −1 is the world."""
    if link < 0:
        return p_LC.copy()
    return motion.p_WL[link] + apply(motion.R_WL[link], p_LC)


@njit(cache=True)
def jacobian(motion, link, p_WC):
    """Return the Jacobian (6, n), [ω; v] in the world, of a frame fixed in a link with its origin at p_WC (3,)."""
    S = motion.S
    J = np.zeros((6, S.shape[0]))
    j = link
    while j >= 0:
        w0, w1, w2 = S[j, 0], S[j, 1], S[j, 2]
        J[0, j], J[1, j], J[2, j] = w0, w1, w2
        J[3, j] = S[j, 3] + w1 * p_WC[2] - w2 * p_WC[1]
        J[4, j] = S[j, 4] + w2 * p_WC[0] - w0 * p_WC[2]
        J[5, j] = S[j, 5] + w0 * p_WC[1] - w1 * p_WC[0]
        j = motion.parent[j]
    return J


@njit(cache=True)
def point_kinematics(motion, link, p_LC):
    """Return position, velocity, Jacobian and J̇q̇ of a point fixed in a link.

    Parameters
    ----------
    motion : TreeMotion
    link : int
        Index of the link.
    p_LC : (3,) array
        The point in the link frame (m).

    Returns
    -------
    p_WC (3,), v_WC (3,), Jv_WC (3,n), Jdotv_WC (3,)
        In the world frame; ``v_WC = Jv_WC @ v`` and ``dv_WC/dt = Jv_WC @ vdot + Jdotv_WC``.
    """
    V, A = motion.V[link], motion.A[link]
    p_WC, w = world_point(motion, link, p_LC), skew(V[:3])
    v_WC = V[3:] + apply(w, p_WC)
    Jdotv_WC = A[3:] + apply(skew(A[:3]), p_WC) + apply(w, v_WC)
    return p_WC, v_WC, jacobian(motion, link, p_WC)[3:], Jdotv_WC


@njit(cache=True)
def _motion_matrix(V):
    """Return the 6×6 matrix of V ×, [[ω×, 0], [v×, ω×]]."""
    X = np.zeros((6, 6))
    X[:3, :3] = skew(V[:3])
    X[3:, :3] = skew(V[3:])
    X[3:, 3:] = X[:3, :3]
    return X


@njit(cache=True)
def _momentum_matrix(h):
    """Return the 6×6 matrix of u ×* h as a function of u, −[[n×, f×], [f×, 0]] of h = [n; f]."""
    H = np.zeros((6, 6))
    H[:3, :3] = -skew(h[:3])
    H[:3, 3:] = -skew(h[3:])
    H[3:, :3] = H[:3, 3:]
    return H


@njit(cache=True)
def _spatial_inertia(tree, motion, j):
    """Return the 6×6 inertia of link j."""
    I, mc, I_O = np.zeros((6, 6)), np.empty(3), np.empty((3, 3))
    world_inertia(tree, motion, j, mc, I_O)
    I[:3, :3] = I_O
    I[:3, 3:] = skew(mc)
    I[3:, :3] = -I[:3, 3:]
    I[3:, 3:] = tree.mass[j] * np.eye(3)
    return I


@njit(cache=True)
def frame_jacobian(motion, link, p_LE):
    """Return the Jacobian (6, n) of a frame fixed in a link, [ω; v] in the world, and its time derivative (6, n).

    Parameters
    ----------
    motion : TreeMotion
    link : int
        Index of the link.
    p_LE : (3,) array
        Origin of the frame, in the link frame (m).
    """
    V, p = motion.V, world_point(motion, link, p_LE)
    v = V[link, 3:] + apply(skew(V[link, :3]), p)
    J, Jdot = jacobian(motion, link, p), np.zeros((6, motion.S.shape[0]))
    j = link
    while j >= 0:
        Sdot = apply(_motion_matrix(V[j]), motion.S[j])
        Jdot[:3, j] = Sdot[:3]
        Jdot[3:, j] = Sdot[3:] + apply(skew(Sdot[:3]), p) + apply(skew(motion.S[j, :3]), v)
        j = motion.parent[j]
    return J, Jdot


@njit(cache=True)
def coriolis_matrix(tree, motion):
    """Return C(q, q̇) (n, n) of a `Tree` that moves as `motion` (`TreeMotion`).

    ``C @ v`` is the Coriolis and centrifugal torque, and ``C + C.T`` the time derivative of M. C is linear in q̇.
    """
    S, n = motion.S, motion.S.shape[0]
    I_c, B_c, Sdot = np.empty((n, 6, 6)), np.empty((n, 6, 6)), np.empty((n, 6))
    for j in range(n):
        X, I = _motion_matrix(motion.V[j]), _spatial_inertia(tree, motion, j)
        XI = product(X.T, I)
        I_c[j], Sdot[j] = I, apply(X, S[j])
        B_c[j] = 0.5 * (_momentum_matrix(apply(I, motion.V[j])) - XI - XI.T)
    C = np.zeros((n, n))
    for j in range(n - 1, -1, -1):
        F1 = apply(I_c[j], Sdot[j]) + apply(B_c[j], S[j])
        F2, F3 = apply(I_c[j], S[j]), apply(B_c[j].T, S[j])
        i = j
        while i >= 0:
            above, below = 0.0, 0.0
            for k in range(6):
                above += S[i, k] * F1[k]
                below += Sdot[i, k] * F2[k] + S[i, k] * F3[k]
            C[j, i] = below
            C[i, j] = above
            i = tree.parent[i]
        k = tree.parent[j]
        if k >= 0:
            I_c[k] += I_c[j]
            B_c[k] += B_c[j]
    return C
