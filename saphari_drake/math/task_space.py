"""A task of a redundant arm and what is left beside it, compiled: inertia, inverse, Coriolis force, projection.

q̇ = J_M^# ẋ + Z ν (36) with J Z = 0 and the inertia-weighted J_M^# = M⁻¹JᵀΛ_x. Corrected: J_M^# where (36) prints the
Moore–Penrose inverse, which would not decouple the two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply, cholesky, product, solve_lower, solve_upper, symmetric_eigen

Array = NDArray[np.float64]


class ConsistentInverse(NamedTuple):
    """Inertia-weighted pseudo-inverse of a Jacobian and what comes with it."""

    Lambda: Array  # (m, m) operational-space inertia Λ_x = (J M⁻¹ Jᵀ)⁻¹, its eigenvalues clipped
    J_inv: Array  # (n, m) J_M^# = M⁻¹ Jᵀ Λ_x
    P: Array  # (n, n) null-space projector I − J_M^# J


class TaskSpace(NamedTuple):
    """A task and what is left beside it, at one state."""

    J: Array  # (m, n) Jacobian
    Jdot: Array  # (m, n) its time derivative
    C: Array  # (n, n) Coriolis matrix with Ṁ = C + Cᵀ
    Lambda: Array  # (m, m) inertia Λ_x, its eigenvalues clipped
    J_inv: Array  # (n, m) J_M^#
    v_task: Array  # (n,) J_M^# ẋ, the joint velocity that the task needs
    v_null: Array  # (n,) Zν, the joint velocity that it does not see


@njit(cache=True)
def consistent_inverse(J: Array, M: Array, max_mass: Array | float) -> ConsistentInverse:
    """Return the dynamically consistent inverse (8) of a Jacobian, bounded at singularities.

    The eigenvalues of Λ, in units of `max_mass`, are clipped at 1. Along a direction u that J cannot move, Jᵀu = 0, so
    the clipped value never becomes a torque; near it the direction goes over to the null space continuously, instead of
    asking for infinite torque. Elsewhere the result is exact.

    Parameters
    ----------
    J : (m, n) array
        Task Jacobian.
    M : (n, n) array
        Inertia matrix.
    max_mass : (m,) array or float
        Largest effective inertia of each task direction, or of all (kg, kg m²).
    """
    m, n = J.shape
    scale = np.sqrt(max_mass * np.ones(m))
    units = np.outer(scale, scale)
    L, M_inv_JT, column = np.empty((n, n)), np.empty((n, m)), np.empty(n)
    cholesky(M, L)
    for k in range(m):
        column[:] = J[k]
        solve_lower(L, column, n)
        solve_upper(L, column, n)
        M_inv_JT[:, k] = column
    share, U = symmetric_eigen(units * product(J, M_inv_JT))
    Lambda = units * product(U / np.maximum(share, 1.0), U.T)
    J_inv = product(M_inv_JT, Lambda)
    return ConsistentInverse(Lambda, J_inv, np.eye(n) - product(J_inv, J))


@njit(cache=True)
def task_space(J: Array, Jdot: Array, M: Array, C: Array, v: Array, max_mass: Array) -> TaskSpace:
    """Return the task space of a Jacobian, bounded at singularities as `consistent_inverse` is.

    Parameters
    ----------
    J, Jdot : (m, n) arrays
        Task Jacobian and its time derivative.
    M, C : (n, n) arrays
        Inertia and Coriolis matrices, Ṁ = C + Cᵀ.
    v : (n,) array
        Joint velocity.
    max_mass : (m,) array
        Largest effective inertia of each task direction (kg, kg m²).
    """
    Lambda, J_inv, _ = consistent_inverse(J, M, max_mass)
    v_task = apply(J_inv, apply(J, v))
    return TaskSpace(J, Jdot, C, Lambda, J_inv, v_task, v - v_task)


@njit(cache=True)
def task_coriolis(task: TaskSpace, w: Array) -> Array:
    """Return μ_x w with μ_x = J_M^{#T} C J_M^# − Λ_x J̇ J_M^#, which makes Λ̇_x − 2μ_x skew-symmetric (m,)."""
    u = apply(task.J_inv, w)
    return apply(task.J_inv.T, apply(task.C, u)) - apply(task.Lambda, apply(task.Jdot, u))


@njit(cache=True)
def project(task: TaskSpace, torque: Array) -> Array:
    """Return P_cᵀ τ = M Z Λ_ν⁻¹ Zᵀ τ, the part of a joint torque that does not accelerate the task (n,)."""
    return torque - apply(task.J.T, apply(task.J_inv.T, torque))


@njit(cache=True)
def velocity_torque(task: TaskSpace) -> Array:
    """Return −C Zν + J̇ᵀΛ_x ẋ − (C + Cᵀ) J_M^# ẋ (n,).

    Its projection is M Z(−Λ_ν⁻¹μ_ν ν − Ż^# q̇) of (39) in (7): J_M^# is differentiated by Zᵀ M J_M^# = 0 and Z by
    J Z = 0, after which no derivative of a basis is left and the torque depends on no choice of one.
    """
    held = apply(task.Jdot.T, apply(task.Lambda, apply(task.J, task.v_task)))
    return held - apply(task.C, task.v_null + task.v_task) - apply(task.C.T, task.v_task)


@njit(cache=True)
def sampled_damping(damping: Array, inertia: Array, period: float, v: Array) -> Array:
    """Return B v with B = (D⁻¹ + T M⁻¹)⁻¹ = D − D(D + M/T)⁻¹D, the damping that a sampled loop can realise.

    It is D where D/M ≪ 1/T and M/T on parts too light for D, such as the last joint of a wrist. It is symmetric
    and positive definite like D, so that proofs for any such damping hold with it.

    Parameters
    ----------
    damping : (k,) array
        Diagonal of D.
    inertia : (k, k) array
        M, of the joints or of the task.
    period : float
        T, the control cycle (s).
    v : (k,) array
        Velocity.
    """
    k, L, force = len(v), np.empty((len(v), len(v))), damping * v
    cut = force.copy()
    cholesky(inertia / period + np.diag(damping), L)
    solve_lower(L, cut, k)
    solve_upper(L, cut, k)
    return force - damping * cut
