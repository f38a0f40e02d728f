"""Plain twin of `saphari_drake.math.task_space`: the null space in coordinates, with inertia and Coriolis matrix.

q̇ = J_M^# ẋ + Z ν (36), with J Z = 0 and Z^# = Λ_ν⁻¹ZᵀM, so that ν = Z^# q̇. The law needs none of it, since its torque
depends on no choice of a basis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class NullSpace(NamedTuple):
    """Null space of a task in the coordinates of a basis."""

    Z: Array  # (n, r) basis
    Zdot: Array  # (n, r) its time derivative
    Z_inv: Array  # (r, n) Z^# = Λ_ν⁻¹ Zᵀ M
    Lambda: Array  # (r, r) Λ_ν = Zᵀ M Z
    mu: Array  # (r, r) μ_ν = Zᵀ(C Z + M Ż), which makes Λ̇_ν − 2μ_ν skew-symmetric


def reference_basis(J: Array) -> Array:
    """Return an orthonormal basis (n, r) of the null space of J (m, n) of full rank, for Z_ref of `null_space`."""
    return np.linalg.svd(J)[2][len(J) :].T


def null_space(J: Array, Jdot: Array, M: Array, C: Array, Z_ref: Array) -> NullSpace:
    """Return basis, inertia and Coriolis matrix of the null space for a constant Z_ref (n, r).

    J must have full rank. With the projector P = I − J^#J, Ṗ = −(J^#J̇P) − (J^#J̇P)ᵀ (Golub and Pereyra, 1973).
    """
    J_inv = np.linalg.pinv(J)
    Z = Z_ref - J_inv @ (J @ Z_ref)
    turn = J_inv @ (Jdot - (Jdot @ J_inv) @ J)
    Zdot = -(turn @ Z_ref) - turn.T @ Z_ref
    Lambda = Z.T @ M @ Z
    return NullSpace(Z, Zdot, np.array(np.linalg.solve(Lambda, Z.T @ M)), Lambda, Z.T @ (C @ Z + M @ Zdot))
