"""Where the shapes of a robot are, and how far from a point; compiled, without memory of their own."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.tree import REVOLUTE


@njit(cache=True, inline="always")
def _times(A, B, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@njit(cache=True, inline="always")
def _placed(R, x, p, out):
    for i in range(3):
        out[i] = p[i] + R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@njit(cache=True)
def shape_poses(body, q, links, shapes):
    """Fill the poses of the links, and of the shapes: each a pair of R (k, 3, 3) and p (k, 3) in the world."""
    (R_WL, p_WL), (R_WS, p_WS), tree = links, shapes, body.tree
    R, turn, p = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for j in range(q.shape[0]):
        k = tree.parent[j]
        if k < 0:
            R[:] = tree.R_PF[j]
            p[:] = tree.p_PF[j]
        else:
            _times(R_WL[k], tree.R_PF[j], R)
            _placed(R_WL[k], tree.p_PF[j], p_WL[k], p)
        a = tree.axis[j]
        if tree.kind[j] == REVOLUTE:
            s, c = np.sin(q[j]), np.cos(q[j])
            for i in range(3):
                for l in range(3):
                    turn[i, l] = (1.0 - c) * a[i] * a[l]
                turn[i, i] += c
                b, d = (i + 1) % 3, (i + 2) % 3
                turn[i, b] -= s * a[d]
                turn[i, d] += s * a[b]
            R_WM = R_WL[j]  # for a moment
            _times(R, turn, R_WM)
            R[:] = R_WM
        else:
            for i in range(3):
                p[i] += q[j] * (R[i, 0] * a[0] + R[i, 1] * a[1] + R[i, 2] * a[2])
        _times(R, tree.R_ML[j], R_WL[j])
        _placed(R, tree.p_ML[j], p, p_WL[j])
    for s in range(body.link.shape[0]):
        k = body.link[s]
        _times(R_WL[k], body.R_LS[s], R_WS[s])
        _placed(R_WL[k], body.p_LS[s], p_WL[k], p_WS[s])


@njit(cache=True, inline="always")
def ball_distance(body, s, shapes, around, o, time):
    """Return the distance (m) of a shape's surface from the centre of a ball after a time; −rounding inside its box."""
    R, p = shapes
    x = around.p[o, 0] + time * around.v[o, 0] - p[s, 0]
    y = around.p[o, 1] + time * around.v[o, 1] - p[s, 1]
    z = around.p[o, 2] + time * around.v[o, 2] - p[s, 2]
    outside = 0.0
    for i in range(3):
        excess = abs(R[s, 0, i] * x + R[s, 1, i] * y + R[s, 2, i] * z) - body.half[s, i]
        if excess > 0.0:
            outside += excess * excess
    return np.sqrt(outside) - body.rounding[s]
