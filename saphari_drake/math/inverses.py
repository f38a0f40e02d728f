"""Inverses that stay bounded where a Jacobian loses rank."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ConsistentInverse(NamedTuple):
    """Inertia-weighted pseudo-inverse of a Jacobian and what comes with it."""

    Lambda: Array  # (m, m) operational-space inertia (J M⁻¹ Jᵀ)⁻¹, its eigenvalues clipped, kg
    J_inv: Array  # (n, m) J_M^# = M⁻¹ Jᵀ Λ
    P: Array  # (n, n) null-space projector I − J_M^# J


def consistent_inverse(J: Array, M: Array, max_mass: float) -> ConsistentInverse:
    """Return the dynamically consistent inverse (8) of a Jacobian, bounded at singularities.

    The eigenvalues of Λ are clipped at `max_mass`. Along a direction u that J cannot move, Jᵀu = 0, so the clipped
    value never becomes a torque; near it the inverse stays continuous and bounded. Away from it the result is exact.

    Parameters
    ----------
    J : (m, n) array
        Task Jacobian.
    M : (n, n) array
        Inertia matrix.
    max_mass : float
        Largest effective mass (kg, for a point task).
    """
    M_inv_JT = np.linalg.solve(M, J.T)
    mobility, U = np.linalg.eigh(J @ M_inv_JT)
    Lambda = (U / np.maximum(mobility, 1.0 / max_mass)) @ U.T
    J_inv = M_inv_JT @ Lambda
    return ConsistentInverse(Lambda, J_inv, np.eye(len(M)) - J_inv @ J)
