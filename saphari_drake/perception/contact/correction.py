"""What the residual says about a contact point that a camera sees: a better point, or that it cannot be the one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.friction_cone import tangents
from saphari_drake.perception.camera.frames import Instant
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]

_RCOND = 1e-3  # share of the largest singular value below which the residual says nothing about force and point
_FARTHEST = 3.0  # deviations of the seen point
_ROUNDS, _WORST = 2, 4.0  # in which the residual's deviation is raised, and by how much in all


def corrected_point(
    robot: RobotModel, at: Instant, r: Array, link: int, p_L: Array, n_L: Array, torque_sigma: float, point_sigma: float
) -> tuple[Array, float]:
    """Return the most likely contact point near a seen one, given the residual, and the deviations it leaves.

    Over force F and shift δ in the tangent plane it minimizes ‖r − J(p + δ)ᵀF‖² / σ_r² + ‖δ‖² / σ_p². A shift changes
    torque j by F · (ω_j × δ) = δ · (F × ω_j), so that with the force of the first round the second one is linear in
    both. Directions in which the residual says nothing keep what is seen, and no shift is larger than three σ_p: where
    force and shift are hard to tell apart, the linear steps could run along the robot.
    A residual that leaves more than the deviations of n − 3 joints is worse than σ_r says, as by friction: then σ_r is
    raised, and the point moves less.

    Parameters
    ----------
    r : (n,) array
        Residual of that time (Nm).
    link, p_L, n_L : int, (3,) and (3,) arrays
        Seen point (m) and outward normal, in the link's frame.
    torque_sigma, point_sigma : float
        Deviation of the residual of each joint (Nm) and of the seen point (m).

    Returns
    -------
    p_L : (3,) array
        Moved in the tangent plane (m).
    left : float
        Square root of the minimum: how many deviations, as given, residual and seen point are apart.
    """
    n, J = robot.n, at.jacobian(link, p_L)
    T = np.empty((2, 3))
    tangents(at.R_WL[link] @ n_L, T[0], T[1])
    moves = np.zeros(n, dtype=bool)
    joint = link
    while joint >= 0:
        moves[joint] = True
        joint = robot.tree.parent[joint]

    def step(sigma: float) -> tuple[Array, float, float]:
        A, b = np.zeros((n + 2, 5)), np.zeros(n + 2)
        A[:n, :3], b[:n] = J.T / sigma, r / sigma
        A[n:, 3:] = np.eye(2) / point_sigma
        F = np.linalg.lstsq(A[:n, :3], b[:n], rcond=_RCOND)[0]
        for _ in range(2):
            A[:n, 3:] = moves[:, None] * np.cross(F, at.motion.S[:, :3]) @ T.T / sigma
            x = np.linalg.lstsq(A, b, rcond=_RCOND)[0]
            F, shift, least = x[:3], x[3:], float(np.linalg.norm(b - A @ x))
            shift *= min(1.0, _FARTHEST * point_sigma / max(float(np.linalg.norm(shift)), 1e-12))
        left = b - A[:, 3:] @ shift
        left -= A[:, :3] @ np.linalg.lstsq(A[:, :3], left, rcond=_RCOND)[0]
        return np.array(shift, dtype=float), float(np.linalg.norm(left)), least

    shift, left, least = step(torque_sigma)
    sigma, usual = torque_sigma, float(np.sqrt(max(n - 3, 1)))
    for _ in range(_ROUNDS):
        if least > usual:
            sigma = min(sigma * least / usual, _WORST * torque_sigma)
            shift, _, least = step(sigma)
    return np.asarray(p_L + at.R_WL[link].T @ (shift @ T)), left
