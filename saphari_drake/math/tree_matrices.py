"""C(q, q̇), Jacobian and its time derivative as matrices, for laws that apply them to other vectors than q̇.

Conventions as in `saphari_drake.math.tree`: spatial quantities are ``[angular; linear]`` at the world origin.
C is the one of the Christoffel symbols, so that Ṁ = C + Cᵀ, computed in one pass over the tree (Echeandia and Wensing,
Numerical Methods to Compute the Coriolis Matrix and Christoffel Symbols for Rigid-Body Systems, 2021).
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply, product
from saphari_drake.math.rotations import skew


@njit(cache=True)
def _motion_matrix(V, X):
    """Fill the 6×6 matrix X of V ×."""
    for i in range(2):
        w = V[3 * i : 3 * i + 3]
        k = 3 * i  # rows 0 to 2: ω; rows 3 to 5: v
        X[k, 1], X[k, 2] = -w[2], w[1]
        X[k + 1, 0], X[k + 1, 2] = w[2], -w[0]
        X[k + 2, 0], X[k + 2, 1] = -w[1], w[0]
    X[3:, 3:] = X[:3, :3]


@njit(cache=True)
def _times(A, x, out):
    for i in range(6):
        total = 0.0
        for k in range(6):
            total += A[i, k] * x[k]
        out[i] = total


@njit(cache=True)
def coriolis_matrix(parent, mass, com, inertia, R_WL, p_WL, S, V):
    """Return C(q, q̇) (n, n) of a tree whose kinematics are known; arguments as in `tree_dynamics`.

    ``C @ v`` is the Coriolis and centrifugal torque, and ``C + C.T`` the time derivative of M. C is linear in q̇.
    """
    n = S.shape[0]
    I_c = np.zeros((n, 6, 6))
    B_c = np.zeros((n, 6, 6))
    Sdot = np.empty((n, 6))
    X, h, R = np.zeros((6, 6)), np.empty(6), np.empty((3, 3))
    for j in range(n):
        I, m = I_c[j], mass[j]
        c = p_WL[j] + apply(R_WL[j], com[j])
        R[:] = product(product(R_WL[j], inertia[j]), R_WL[j].T)
        cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
        for a in range(3):
            for b in range(3):
                I[a, b] = R[a, b] - m * c[a] * c[b]
            I[a, a] += m * cc
            I[3 + a, 3 + a] = m
        I[0, 4], I[0, 5] = -m * c[2], m * c[1]
        I[1, 3], I[1, 5] = m * c[2], -m * c[0]
        I[2, 3], I[2, 4] = -m * c[1], m * c[0]
        for a in range(3):
            for b in range(3):
                I[3 + b, a] = I[a, 3 + b]
        _motion_matrix(V[j], X)
        _times(X, S[j], Sdot[j])
        _times(I, V[j], h)
        # B = ½(H − Xᵀ I − I X), H u = u ×* h.
        B = B_c[j]
        for a in range(6):
            for b in range(6):
                total = 0.0
                for k in range(6):
                    total -= X[k, a] * I[k, b] + I[a, k] * X[k, b]
                B[a, b] = 0.5 * total
        for i in range(2):
            k = 3 * i
            for first, second in ((0, k), (3, 0)):
                if first == 0 or i == 1:
                    B[first, second + 1] += 0.5 * h[k + 2]
                    B[first, second + 2] -= 0.5 * h[k + 1]
                    B[first + 1, second] -= 0.5 * h[k + 2]
                    B[first + 1, second + 2] += 0.5 * h[k]
                    B[first + 2, second] += 0.5 * h[k + 1]
                    B[first + 2, second + 1] -= 0.5 * h[k]
    C = np.zeros((n, n))
    F1, F2, F3, G = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    for j in range(n - 1, -1, -1):
        _times(I_c[j], Sdot[j], F1)
        _times(B_c[j], S[j], G)
        F1 += G
        _times(I_c[j], S[j], F2)
        _times(B_c[j].T, S[j], F3)
        i = j
        while i >= 0:
            above, below = 0.0, 0.0
            for k in range(6):
                above += S[i, k] * F1[k]
                below += Sdot[i, k] * F2[k] + S[i, k] * F3[k]
            C[i, j] = above
            if i != j:
                C[j, i] = below
            i = parent[i]
        k = parent[j]
        if k >= 0:
            I_c[k] += I_c[j]
            B_c[k] += B_c[j]
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
    p = p_WL[link] + apply(R_WL[link], p_LE)
    v = V[link, 3:] + apply(skew(V[link, :3]), p)
    X, Sdot = np.zeros((6, 6)), np.empty(6)
    j = link
    while j >= 0:
        w = skew(S[j, :3])
        _motion_matrix(V[j], X)
        _times(X, S[j], Sdot)
        J[:3, j] = S[j, :3]
        J[3:, j] = S[j, 3:] + apply(w, p)
        Jdot[:3, j] = Sdot[:3]
        Jdot[3:, j] = Sdot[3:] + apply(skew(Sdot[:3]), p) + apply(w, v)
        j = parent[j]
    return J, Jdot
