"""Null space of a redundant arm in coordinates: continuous bases, their inertia and Coriolis matrix.

q̇ = J_M^# ẋ + Z ν (36), with J Z = 0 and Z^# = Λ_ν⁻¹ZᵀM, so that ν = Z^# q̇. The control law needs none of it, since its
torque depends on no choice of a basis (`saphari_drake.math.task_space`); whoever shapes ν itself does.
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


def damped_inverse(J: Array, threshold: float) -> Array:
    """Return J^# (n, m), with singular values below `threshold` damped so that it stays continuous and bounded.

    1/σ becomes (2 − σ²/ε²)σ/ε² for σ < ε, which fits value and slope at ε and goes to zero with σ.
    """
    U, sigma, VT = np.linalg.svd(J, full_matrices=False)
    ratio = np.minimum(sigma / threshold, 1.0)
    inverse = np.where(ratio < 1.0, (2.0 - ratio**2) * ratio / threshold, 1.0 / np.maximum(sigma, threshold))
    return (VT.T * inverse) @ U.T


def transported_basis(J: Array, Z_ref: Array, threshold: float = 0.02) -> Array:
    """Return Z = (I − J^#J) Z_ref (n, r), continuous in J for a constant Z_ref.

    An SVD of each J would give a basis too, but one that jumps: its vectors are arbitrary rotations. Between ‖J Z‖ = 0
    and singular values below `threshold`, where ‖J Z‖ ≤ threshold, there is no jump either. Z loses rank only where a
    direction of the null space is normal to all of Z_ref; a Z_ref that follows the posture (the orthonormalised last
    Z) never gets there.
    """
    return Z_ref - damped_inverse(J, threshold) @ (J @ Z_ref)


def orthonormal(Z: Array) -> Array:
    """Return the orthonormal basis of the same space nearest to Z (n, r) (polar decomposition)."""
    U, _, VT = np.linalg.svd(Z, full_matrices=False)
    return U @ VT


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
