"""Plain twin of the reverse-priority law: the recursion (24)–(27) as printed, regularised, and the forward scheme.

Levels are numbered from the top: level 0 has the highest priority. The functions take one level after the other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A row whose part outside the span of the rows before it is shorter than this (in the unit of the row) depends on them.
RANK_TOLERANCE = 1e-8


def append_row_inverse(R: Array, R_inv: Array, row: Array, tolerance: float = RANK_TOLERANCE) -> Array:
    """Return the pseudo-inverse of [row; R] from that of R (Greville's row update).

    With d = j R^# and c = j − d R: t = cᵀ/(c cᵀ) if ‖c‖ > tolerance, otherwise t = R^# dᵀ/(1 + d dᵀ); the new
    inverse is [t, R^# − t d].

    Parameters
    ----------
    R : (m, n) array
        Rows so far; m = 0 is allowed.
    R_inv : (n, m) array
        Their pseudo-inverse.
    row : (n,) array
        Row to put on top.
    tolerance : float
        Absolute: a relative one would take a short independent row for a dependent one.
    """
    d = row @ R_inv
    c = row - d @ R
    t = c / (c @ c) if np.linalg.norm(c) > tolerance else R_inv @ d / (1.0 + d @ d)
    return np.column_stack([t, R_inv - np.outer(t, d)])


def augmented_inverse(J: Array, R: Array, R_inv: Array, tolerance: float = RANK_TOLERANCE) -> Array:
    """Return the pseudo-inverse (26) of the reverse augmented Jacobian [J; R] of (25); its first m columns are T."""
    for row in J[::-1]:
        R_inv = append_row_inverse(R, R_inv, row, tolerance)
        R = np.vstack([row, R])
    return R_inv


def reverse_priority(
    jacobians: Sequence[Array], rates: Sequence[Array], v_null: Array, tolerance: float = RANK_TOLERANCE
) -> Array:
    """Return the joint velocity of the reverse-priority recursion (24)–(26).

    From the lowest level up: q̇ ← q̇ + T (J T)^# (ẋ − J q̇). For J of full row rank J T is positive definite, even if
    its rows depend on those of lower levels, so that the level put on top last is exact. Its step is the shortest of
    those that deform the levels below the least: min ‖δ‖ over argmin ‖R δ‖ subject to J δ = ẋ − J q̇.

    Parameters
    ----------
    jacobians : sequence of (m_p, n) arrays
        Task Jacobians, highest priority first.
    rates : sequence of (m_p,) arrays
        Desired task velocities ẋ.
    v_null : (n,) array
        q̇ below all tasks: λ times the command before gives the smoothest motion, eq. (27).
    tolerance : float
        Absolute rank tolerance, for rows and for the singular values of J T.
    """
    v = np.array(v_null, dtype=float)
    R, R_inv = np.zeros((0, v.size)), np.zeros((v.size, 0))
    for J, rate in zip(reversed(jacobians), reversed(rates), strict=True):
        R_inv = augmented_inverse(J, R, R_inv, tolerance)
        R = np.vstack([J, R])
        T = R_inv[:, : len(J)]
        v = v + T @ (truncated_inverse(J @ T, tolerance) @ (rate - J @ v))
    return v


def forward_priority(
    jacobians: Sequence[Array], rates: Sequence[Array], v_null: Array, tolerance: float = RANK_TOLERANCE
) -> Array:
    """Return the joint velocity of the classical scheme: each level in the null space of all above it.

    q̇ ← q̇ + (J P)^# (ẋ − J q̇), P the projector on the null space of the levels so far, `v_null` projected at the end.
    Equal to `reverse_priority` for tasks whose rows are all independent.
    """
    n = len(v_null)
    v, P = np.zeros(n), np.eye(n)
    for J, rate in zip(jacobians, rates, strict=True):
        inverse = truncated_inverse(J @ P, tolerance)
        v = v + inverse @ (rate - J @ v)
        P = P - inverse @ (J @ P)
    return v + P @ np.asarray(v_null, dtype=float)


def truncated_inverse(A: Array, tolerance: float) -> Array:
    """Return the pseudo-inverse of a matrix, singular values of at most `tolerance` taken for zero."""
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    keep = s > tolerance
    return np.asarray((Vt[keep].T / s[keep]) @ U[:, keep].T)


def regularised_step(J: Array, b: Array, W: Array, damping: Array | float) -> Array:
    """Return δ = W⁻¹Jᵀ(J W⁻¹Jᵀ + D)⁻¹ b, the step of (24) that stays bounded at singular postures.

    With W = λ_s² I + Σ h_i J_iᵀJ_i over the rows of the lower levels it tends to the exact step as λ_s → 0, and is
    continuous in the activations h_i, which stacking and unstacking rows is not.

    Parameters
    ----------
    J : (m, n) array
        Jacobian of the level.
    b : (m,) array
        What is missing, ẋ − J q̇.
    W : (n, n) array
        Weight of the levels below, positive definite.
    damping : (m, m) array or float
        D, positive semi-definite; a number stands for that multiple of the identity.
    """
    D = damping * np.eye(len(J)) if np.ndim(damping) == 0 else np.asarray(damping)
    W_inv_JT = np.linalg.solve(W, J.T)
    return np.asarray(W_inv_JT @ np.linalg.solve(J @ W_inv_JT + D, b))


def singular_damping(J: Array, lam_s: float, mu: float) -> Array:
    """Return D = μ (λ_s² (J Jᵀ + λ_s² I)⁻¹)², the damping of a task near its singular postures alone.

    D = μI gives the damped inverse Jᵀ(J Jᵀ + μ λ_s² I)⁻¹ of a task on its own, but on a conflict with active rows below
    it shares with them, 1 to μ, whatever λ_s is: the lower level then holds back the higher one. This D is μ where a
    singular value σ of J is well below λ_s, and falls as (λ_s/σ)⁴ above it.
    """
    B = lam_s**2 * np.linalg.inv(J @ J.T + lam_s**2 * np.eye(len(J)))
    return np.asarray(mu * B @ B)
