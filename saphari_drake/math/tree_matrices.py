"""C(q, q̇), Jacobian and its time derivative as matrices, for laws that apply them to other vectors than q̇.

Conventions as in `saphari_drake.math.tree`: spatial quantities are ``[angular; linear]`` at the world origin.
C is the one of the Christoffel symbols, so that Ṁ = C + Cᵀ, computed in one pass over the tree (Echeandia and Wensing,
Numerical Methods to Compute the Coriolis Matrix and Christoffel Symbols for Rigid-Body Systems, 2021).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from saphari_drake.math.rotations import skew


@njit(cache=True)
def _motion_matrix(V):
    """Return the 6×6 matrix of V ×."""
    X = np.zeros((6, 6))
    w = skew(V[:3])
    X[:3, :3] = w
    X[3:, 3:] = w
    X[3:, :3] = skew(V[3:])
    return X


@njit(cache=True)
def coriolis_matrix(parent, mass, com, inertia, R_WL, p_WL, S, V):
    """Return C(q, q̇) (n, n) of a tree whose kinematics are known; arguments as in `tree_dynamics`.

    ``C @ v`` is the Coriolis and centrifugal torque, and ``C + C.T`` the time derivative of M. C is linear in q̇.
    """
    n = S.shape[0]
    I_c = np.zeros((n, 6, 6))
    B_c = np.zeros((n, 6, 6))
    Sdot = np.empty((n, 6))
    for j in range(n):
        c = skew(p_WL[j] + R_WL[j] @ com[j])
        I = np.zeros((6, 6))
        I[:3, :3] = R_WL[j] @ inertia[j] @ R_WL[j].T - mass[j] * (c @ c)
        I[:3, 3:] = mass[j] * c
        I[3:, :3] = -mass[j] * c
        for a in range(3):
            I[3 + a, 3 + a] = mass[j]
        X = _motion_matrix(V[j])
        h = I @ V[j]
        # The matrix H of H u = u ×* h.
        H = np.zeros((6, 6))
        H[:3, :3] = -skew(h[:3])
        H[:3, 3:] = -skew(h[3:])
        H[3:, :3] = -skew(h[3:])
        I_c[j] = I
        B_c[j] = 0.5 * (H - X.T @ I - I @ X)
        Sdot[j] = X @ S[j]
    C = np.zeros((n, n))
    for j in range(n - 1, -1, -1):
        F1 = I_c[j] @ Sdot[j] + B_c[j] @ S[j]
        F2 = I_c[j] @ S[j]
        F3 = B_c[j].T @ S[j]
        C[j, j] = np.dot(S[j], F1)
        i = parent[j]
        while i >= 0:
            C[i, j] = np.dot(S[i], F1)
            C[j, i] = np.dot(Sdot[i], F2) + np.dot(S[i], F3)
            i = parent[i]
        if parent[j] >= 0:
            I_c[parent[j]] += I_c[j]
            B_c[parent[j]] += B_c[j]
    return C


@njit(cache=True)
def frame_jacobian(parent, S, V, R_WL, p_WL, link, p_LE):
    """Return the Jacobian (6, n) of a frame fixed in a link, [ω; v] in the world, and its time derivative (6, n).

    Parameters
    ----------
    link : int
        Index of the link.
    p_LE : (3,) array
        Origin of the frame, in the link frame (m).
    """
    n = S.shape[0]
    J = np.zeros((6, n))
    Jdot = np.zeros((6, n))
    p = p_WL[link] + R_WL[link] @ p_LE
    v = V[link, 3:] + skew(V[link, :3]) @ p
    j = link
    while j >= 0:
        w = skew(S[j, :3])
        Sdot = _motion_matrix(V[j]) @ S[j]
        J[:3, j] = S[j, :3]
        J[3:, j] = S[j, 3:] + w @ p
        Jdot[:3, j] = Sdot[:3]
        Jdot[3:, j] = Sdot[3:] + skew(Sdot[:3]) @ p + w @ v
        j = parent[j]
    return J, Jdot
