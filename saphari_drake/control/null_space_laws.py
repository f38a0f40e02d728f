"""Laws of Section 5 as functions of arrays: task error, task force of Propositions 1 to 3, null-space torque."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.math.null_space import TaskSpace, sampled_damping
from saphari_drake.math.rotations import skew

Array = NDArray[np.float64]


class TaskError(NamedTuple):
    """Error of a task of dimension 3 (position) or 6 (orientation, then position), in the world."""

    error: Array  # (m,) x̃: x_d − x (m), log(R_d Rᵀ)^∨ (rad)
    velocity: Array  # (m,) x_d' − x', desired minus actual velocity
    error_rate: Array  # (m,) time derivative of `error`; differs from `velocity` for large rotations
    acceleration: Array  # (m,) desired acceleration


class TaskGains(NamedTuple):
    """Gains of a task of dimension m; unused ones may have any value."""

    P: Array  # (m,) 1/s, Proposition 1
    K: Array  # (m,) Ns/m, Nms/rad, Proposition 1
    D: Array  # (m,) Ns/m, Nms/rad, Proposition 2
    K_x: Array  # (m,) N/m, Nm/rad, Proposition 2
    gamma: float  # 1/s, Proposition 2
    K_v: Array  # (m,) 1/s, Proposition 3
    K_p: Array  # (m,) 1/s², Proposition 3
    scale: Array  # (m,) 1, or m/rad: length that makes rotation comparable
    period: float  # s


class TaskForce(NamedTuple):
    """Generalized force (m,) of the task, in the parts that are named in the torque."""

    task: Array  # feedback and feedforward
    compensation: Array  # against the estimated external torque
    drive: Array  # (n,) what the disturbance observer integrates


def rotation_log(R: Array) -> Array:
    """Return the rotation vector (3,) of a rotation matrix, of length up to π."""
    axial = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = float(np.sqrt(axial @ axial)), 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return axial * (angle / sine)
    if cosine > 0.0:
        return axial
    B = 0.5 * (R + R.T) + np.eye(3)  # 2 u uᵀ at half a turn
    column = B[:, int(np.argmax(np.diag(B)))]
    return angle * column / np.linalg.norm(column)


def rotation_rate(e: Array, w_desired: Array, w: Array) -> Array:
    """Return d/dt log(R_d Rᵀ)^∨ = J_l(e)⁻¹ ω_d − J_r(e)⁻¹ ω (3,)."""
    angle = float(np.sqrt(e @ e))
    c = 1.0 / 12.0 if angle < 1e-3 else 1.0 / angle**2 - 0.5 / (angle * np.tan(0.5 * angle))
    E = skew(e)
    return w_desired - w - 0.5 * (E @ (w_desired + w)) + c * (E @ (E @ (w_desired - w)))


def task_error(R: Array, p: Array, V: Array, R_d: Array, p_d: Array, V_d: Array, A_d: Array, m: int) -> TaskError:
    """Return the error of a frame at (R, p) moving with V = [ω; v] from a desired motion, of which m = 3 or 6 count."""
    if m == 3:
        velocity = V_d[3:] - V[3:]
        return TaskError(p_d - p, velocity, velocity, A_d[3:])
    turn = rotation_log(R_d @ R.T)
    velocity = V_d - V
    rate = np.concatenate([rotation_rate(turn, V_d[:3], V[:3]), velocity[3:]])
    return TaskError(np.concatenate([turn, p_d - p]), velocity, rate, A_d)


def saturated(error: Array, scale: Array) -> Array:
    """Return f(x̃) = x̃ / (1 + ‖x̃‖) (44) with the norm in metres: rotation counts by the length `scale` (m,)."""
    scaled = scale * error
    return error / (1.0 + float(np.sqrt(scaled @ scaled)))


def task_force(observer: str, task: TaskSpace, e: TaskError, estimate: Array, v: Array, gains: TaskGains) -> TaskForce:
    """Return the task force Λ_x(ẍ_c − J̇q̇) of a proposition; the closed loop below is exact away from singularities.

    - ``task_error`` (41): Λ_x s' + (μ_x + K)s = J_M^{#T}(τ_ext − τ̂), s = x̃' + P x̃.
    - ``task_error_pd`` (43): Λ_x x̃'' + (μ_x + D)x̃' + K x̃ = J_M^{#T}(τ_ext − τ̂); ``none``: the same with τ̂ = 0.
    - ``momentum`` (46): x̃'' + K_v x̃' + K_p x̃ = Λ_x⁻¹J_M^{#T}(τ_ext − τ̂) with τ̂ = −r.

    Desired accelerations are added to the printed laws for constant targets. K and D enter as `sampled_damping`.

    Parameters
    ----------
    observer : str
        One of the names above.
    task, e :
        Task space and error.
    estimate : (n,) array
        τ̂, the estimated external torque (Nm).
    v : (n,) array
        Joint velocity (rad/s or m/s).
    gains :
        Gains; see `TaskGains`.
    """
    feedforward = e.acceleration - task.Jdot @ v
    compensation = task.J_inv.T @ estimate
    if observer == "task_error":
        s = e.velocity + gains.P * e.error
        K = sampled_damping(np.diag(gains.K), task.Lambda, gains.period)
        force = task.Lambda @ (feedforward + gains.P * e.error_rate) + task.coriolis(s) + K @ s
        return TaskForce(force, compensation, task.J_inv @ s)
    if observer == "momentum":
        force = task.Lambda @ (feedforward + gains.K_v * e.velocity + gains.K_p * e.error)
        return TaskForce(force, compensation, np.zeros_like(v))
    D = sampled_damping(np.diag(gains.D), task.Lambda, gains.period)
    force = task.Lambda @ feedforward + task.coriolis(e.velocity) + D @ e.velocity + gains.K_x * e.error
    if observer == "none":
        return TaskForce(force, np.zeros_like(compensation), np.zeros_like(v))
    return TaskForce(force, compensation, task.J_inv @ (e.velocity + gains.gamma * saturated(e.error, gains.scale)))


def null_space_torque(
    task: TaskSpace, q_error: Array, M: Array, stiffness: Array, damping: Array, period: float
) -> Array:
    """Return the null-space part of τ = M q̈_c + C q̇ + g for (39), without any choice of a basis (n,).

    It is P_cᵀ(K_p q̃ − B Zν − C Zν + J̇ᵀΛ_xẋ − (C + Cᵀ)J_M^#ẋ), equal to M Z(ν̇_c − Ż^#q̇) with B_ν = ZᵀB Z, and gives
    Λ_ν ν̇ + (μ_ν + B_ν)ν = Zᵀ(K_p q̃ − τ_ext) (40). Without a basis there is none that could jump or lose rank.

    Parameters
    ----------
    q_error : (n,) array
        q̃ = q_d − q (rad or m).
    stiffness, damping : (n,) arrays
        Diagonals of K_p and B (Nm/rad, Nms/rad); B enters as `sampled_damping`, since the last joints of a wrist are
        too light for a damping that suits the others.
    """
    B = sampled_damping(np.diag(damping), M, period)
    return task.project(stiffness * q_error - B @ task.v_null + task.velocity_torque())


def gamma_bound(inertia: Array, stiffness: Array, damping: Array, coriolis: float) -> float:
    """Return the γ below which Proposition 2 holds (1/s).

    γ < min{ √(λ_min k_min)/λ_max, d/(λ_max + k_c + d²/(4k)) }: the first keeps the Lyapunov function positive definite,
    the second its derivative negative semidefinite.

    Parameters
    ----------
    inertia : (…, m, m) array
        Λ_x at the postures to be covered; λ_min and λ_max are the extreme eigenvalues.
    stiffness, damping : (m,) arrays
        Diagonals of K and D. The smallest entries count, and of d²/(4k) the largest.
    coriolis : float
        k_c with ‖μ_x‖ ≤ k_c ‖ẋ‖ (kg/m).
    """
    eigenvalues = np.linalg.eigvalsh(inertia)
    low, high = float(eigenvalues.min()), float(eigenvalues.max())
    k, d = float(stiffness.min()), float(damping.min())
    return min(np.sqrt(low * k) / high, d / (high + coriolis + float(np.max(damping**2 / (4.0 * stiffness)))))


def require_gamma(gamma: float, bound: float) -> None:
    """Demand γ below its bound, or raise `ParameterError` naming both."""
    if not gamma < bound:
        what = f"must be below {bound:.3g} 1/s for these K_x and D and this arm around its home posture, got {gamma:g}"
        raise ParameterError("gamma", what)
