"""Scalar components of a robot, x_C(q): value, Jacobian row, and rate that the joints do not make.

Each is a row of a table: its kind, the link and the point p_LC it belongs to, an index, a direction and a length. What
an index means, and the unit, depend on the kind::

    JOINT      q_index                                    rad or m
    PLANE      a·p_WC − length                            m, a in the world: signed distance to a plane
    DISTANCE   ‖p_WC − p_WO‖ − length                     m, to the target with that index
    VIEW       cosine of the angle at p_WC between the    1, a in the link: optical axis of a camera
               axis a and the ray to the target
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply, product

JOINT, PLANE, DISTANCE, VIEW = 0, 1, 2, 3

_NEAR = 1e-9  # m; closer than this a target has no direction


@njit(cache=True)
def point_rows(parent, S, link, p_WC, J):
    """Write the 6×n Jacobian [ω; v] of a point of a link into J (zeroed); link −1 is the world."""
    j = link
    while j >= 0:
        w0, w1, w2 = S[j, 0], S[j, 1], S[j, 2]
        J[0, j], J[1, j], J[2, j] = w0, w1, w2
        J[3, j] = S[j, 3] + w1 * p_WC[2] - w2 * p_WC[1]
        J[4, j] = S[j, 4] + w2 * p_WC[0] - w0 * p_WC[2]
        J[5, j] = S[j, 5] + w0 * p_WC[1] - w1 * p_WC[0]
        j = parent[j]


@njit(cache=True)
def world_point(R_WL, p_WL, link, p_LC):
    """Return a point of a link in the world; link −1 is the world itself."""
    if link < 0:
        return p_LC.copy()
    return p_WL[link] + apply(R_WL[link], p_LC)


@njit(cache=True)
def feature(parent, S, R_WL, p_WL, q, kind, link, p_LC, index, a, length, targets, row):
    """Write the Jacobian row of one component into `row` (zeroed); return its value and its own rate.

    Parameters
    ----------
    parent, S, R_WL, p_WL, q :
        Kinematics of the tree, as from `saphari_drake.math.tree.tree_kinematics`, and joint positions.
    kind, link, p_LC, index, a, length :
        Row of the table, see the module.
    targets : (k, 6) array
        Position (m) and velocity (m/s) of each target in the world.
    """
    n = q.shape[0]
    if kind == JOINT:
        row[index] = 1.0
        return q[index], 0.0
    J = np.zeros((6, n))
    p_WC = world_point(R_WL, p_WL, link, p_LC)
    point_rows(parent, S, link, p_WC, J)
    if kind == PLANE:
        value = -length
        for i in range(3):
            value += a[i] * p_WC[i]
            for j in range(n):
                row[j] += a[i] * J[3 + i, j]
        return value, 0.0
    u = targets[index, :3] - p_WC
    distance = np.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    own = 0.0
    if distance < _NEAR:
        return (-length if kind == DISTANCE else 0.0), own
    u /= distance
    if kind == DISTANCE:
        for i in range(3):
            own += u[i] * targets[index, 3 + i]
            for j in range(n):
                row[j] -= u[i] * J[3 + i, j]
        return distance - length, own
    axis = a.copy() if link < 0 else apply(R_WL[link], a)
    cosine = axis[0] * u[0] + axis[1] * u[1] + axis[2] * u[2]
    turn = np.cross(axis, u)
    for i in range(3):
        across = (axis[i] - cosine * u[i]) / distance
        own += across * targets[index, 3 + i]
        for j in range(n):
            row[j] += turn[i] * J[i, j] - across * J[3 + i, j]
    return cosine, own


@njit(cache=True)
def feature_table(parent, S, R_WL, p_WL, q, kinds, links, points, indices, directions, lengths, signs, targets):
    """Return values (c,), Jacobian (c, n) and own rates (c,) of a table of components, each times its sign."""
    count = kinds.shape[0]
    x, J, own = np.empty(count), np.zeros((count, q.shape[0])), np.empty(count)
    for i in range(count):
        x[i], own[i] = feature(
            parent,
            S,
            R_WL,
            p_WL,
            q,
            kinds[i],
            links[i],
            points[i],
            indices[i],
            directions[i],
            lengths[i],
            targets,
            J[i],
        )
        x[i] *= signs[i]
        own[i] *= signs[i]
        for j in range(q.shape[0]):
            J[i, j] *= signs[i]
    return x, J, own


@njit(cache=True)
def rotation_error(R, R_target):
    """Return the rotation vector of R_target Rᵀ (world, rad): the turn that is missing, up to π."""
    E = product(R_target, R.T)
    w = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]]) * 0.5
    s = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    c = 0.5 * (E[0, 0] + E[1, 1] + E[2, 2] - 1.0)
    angle = np.arctan2(s, c)
    if s > 1e-9:
        return w * (angle / s)
    if c > 0.0:
        return w
    # Half a turn: E + I = 2 u uᵀ.
    k = 0
    for i in range(1, 3):
        if E[i, i] > E[k, k]:
            k = i
    u = E[:, k].copy()
    u[k] += 1.0
    return u * (np.pi / np.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]))
