"""Task space and null space of a redundant arm: continuous basis, inertias, Coriolis matrices, decoupled torque.

q̇ = J_M^# ẋ + Z ν (36), with J Z = 0, the inertia-weighted J_M^# = M⁻¹JᵀΛ_x and Z^# = Λ_ν⁻¹ZᵀM, so that ẋ = J q̇ and
ν = Z^# q̇. Corrected: J_M^# where (36) prints the Moore–Penrose inverse, which would not decouple the two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class TaskSpace(NamedTuple):
    """A task and what is left beside it, at one state."""

    J: Array  # (m, n) Jacobian
    Jdot: Array  # (m, n) its time derivative
    C: Array  # (n, n) Coriolis matrix with Ṁ = C + Cᵀ
    Lambda: Array  # (m, m) inertia Λ_x, its eigenvalues clipped
    J_inv: Array  # (n, m) J_M^#
    v_task: Array  # (n,) J_M^# ẋ, the joint velocity that the task needs
    v_null: Array  # (n,) Zν, the joint velocity that it does not see

    def coriolis(self, w: Array) -> Array:
        """Return μ_x w with μ_x = J_M^{#T} C J_M^# − Λ_x J̇ J_M^#, which makes Λ̇_x − 2μ_x skew-symmetric (m,)."""
        u = self.J_inv @ w
        return self.J_inv.T @ (self.C @ u) - self.Lambda @ (self.Jdot @ u)

    def project(self, torque: Array) -> Array:
        """Return P_cᵀ τ = M Z Λ_ν⁻¹ Zᵀ τ, the part of a joint torque that does not accelerate the task (n,)."""
        return torque - self.J.T @ (self.J_inv.T @ torque)

    def velocity_torque(self) -> Array:
        """Return −C Zν + J̇ᵀΛ_x ẋ − (C + Cᵀ) J_M^# ẋ (n,).

        Its projection is M Z(−Λ_ν⁻¹μ_ν ν − Ż^# q̇) of (39) in (7): J_M^# is differentiated by Zᵀ M J_M^# = 0 and Z by
        J Z = 0, after which no derivative of a basis is left and the torque depends on no choice of one.
        """
        velocity = self.C @ self.v_null + self.C @ self.v_task + self.v_task @ self.C
        return -velocity + self.Jdot.T @ (self.Lambda @ (self.J @ self.v_task))


def task_space(J: Array, Jdot: Array, M: Array, C: Array, v: Array, max_mass: float | Array) -> TaskSpace:
    """Return the task space of a Jacobian, bounded at singularities.

    Parameters
    ----------
    J, Jdot : (m, n) arrays
        Task Jacobian and its time derivative.
    M, C : (n, n) arrays
        Inertia and Coriolis matrices, Ṁ = C + Cᵀ.
    v : (n,) array
        Joint velocity.
    max_mass : float or (m,) array
        Largest effective inertia, one or one a task direction (kg, kg m²). A direction that J is about to lose goes
        over to the null space continuously, instead of asking for infinite torque. Elsewhere the result is exact.
    """
    M_inv_JT = np.linalg.solve(M, J.T)
    scale = np.sqrt(np.broadcast_to(max_mass, len(J)))
    mobility, U = np.linalg.eigh((J @ M_inv_JT) * np.outer(scale, scale))
    root = scale[:, None] * U
    Lambda = (root / np.maximum(mobility, 1.0)) @ root.T
    J_inv = M_inv_JT @ Lambda
    v_task = J_inv @ (J @ v)
    return TaskSpace(J, Jdot, C, Lambda, J_inv, v_task, v - v_task)


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


def sampled_damping(D: Array, inertia: Array, period: float) -> Array:
    """Return (D⁻¹ + T M⁻¹)⁻¹ = D − D(D + M/T)⁻¹D, the damping that a sampled loop can realise.

    It is D where D/M ≪ 1/T and M/T on parts too light for D, such as the last joint of a wrist. It is symmetric
    and positive definite like D, so that proofs for any such damping hold with it.
    """
    return D - D @ np.linalg.solve(D + inertia / period, D)
