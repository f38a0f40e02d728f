"""Laws of Section 5, compiled: task error, task force of Propositions 1 to 3, null-space torque, the whole command."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply, product
from saphari_drake.math.rotations import axis_rotation, skew
from saphari_drake.math.task_space import (
    TaskSpace,
    project,
    sampled_damping,
    task_coriolis,
    task_space,
    velocity_torque,
)
from saphari_drake.math.tree_matrices import coriolis_matrix, frame_jacobian

Array = NDArray[np.float64]
NONE, TASK_ERROR, TASK_ERROR_PD, MOMENTUM = range(4)  # observers, in the order of their names
# s; time constants of a target that follows the frame while the task yields, and starts and ends its return; m, rad.
FOLLOWING, STARTING, SETTLING, NEAR = 0.05, 0.25, 0.15, 1e-7


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


class FrameState(NamedTuple):
    """A frame fixed in a link, and the task space of its position (m = 3) or pose (m = 6)."""

    task: TaskSpace
    R: Array  # (3, 3) rotation in the world
    p: Array  # (3,) position in the world (m)
    V: Array  # (6,) velocity [ω; v] in the world


@njit(cache=True)
def rotation_log(R: Array) -> Array:
    """Return the rotation vector (3,) of a rotation matrix, of length up to π."""
    axial = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = np.sqrt(np.sum(axial * axial)), 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return axial * (angle / sine)
    if cosine > 0.0:
        return axial
    B = 0.5 * (R + R.T) + np.eye(3)  # 2 u uᵀ at half a turn
    column = B[:, np.argmax(np.diag(B))]
    return column * (angle / np.sqrt(np.sum(column * column)))


@njit(cache=True)
def rotation_rate(e: Array, w_desired: Array, w: Array) -> Array:
    """Return d/dt log(R_d Rᵀ)^∨ = J_l(e)⁻¹ ω_d − J_r(e)⁻¹ ω (3,)."""
    angle = np.sqrt(np.sum(e * e))
    c = 1.0 / 12.0 if angle < 1e-3 else 1.0 / angle**2 - 0.5 / (angle * np.tan(0.5 * angle))
    E, wrong = skew(e), w_desired - w
    return wrong - 0.5 * apply(E, w_desired + w) + c * apply(E, apply(E, wrong))


@njit(cache=True)
def task_error(R, p, V, R_d, p_d, V_d, A_d, m) -> TaskError:
    """Return the error of a frame at (R, p) moving with V = [ω; v] from a desired motion, of which m = 3 or 6 count."""
    velocity = V_d[6 - m :] - V[6 - m :]
    error, rate = np.empty(m), velocity.copy()
    error[m - 3 :] = p_d - p
    if m == 6:
        error[:3] = rotation_log(product(R_d, R.T))
        rate[:3] = rotation_rate(error[:3], V_d[:3], V[:3])
    return TaskError(error, velocity, rate, A_d[6 - m :])


@njit(cache=True)
def advance_offset(offset, speed, away, yielding, limit, period):
    """Return the offset of the target from the desired motion (3,) and its speed towards zero, after one period.

    While the task yields the target follows the frame, which is `away` from the desired one; after that it goes back
    with no more than the speed `limit`, which it takes up and leaves gradually.
    """
    offset = offset + (1.0 - np.exp(-yielding * period / FOLLOWING)) * (away - offset)
    distance = np.sqrt(np.sum(offset * offset))
    if yielding > 0.0:
        return offset, 0.0
    if distance < NEAR:
        return np.zeros(3), 0.0
    speed = min(speed + limit * period / STARTING, limit, distance / SETTLING)
    return offset * max(0.0, 1.0 - speed * period / distance), speed


@njit(cache=True)
def toward_zero(offset, speed):
    """Return the velocity (3,) of an offset that shrinks with a speed."""
    distance = np.sqrt(np.sum(offset * offset))
    return offset * (-speed / distance) if distance > 0.0 else np.zeros(3)


@njit(cache=True)
def rotation_exp(e: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector."""
    angle = np.sqrt(np.sum(e * e))
    return axis_rotation(e / angle, angle) if angle > 0.0 else np.eye(3)


@njit(cache=True)
def saturated(error: Array, scale: Array) -> Array:
    """Return f(x̃) = x̃ / (1 + ‖x̃‖) (44) with the norm in metres: rotation counts by the length `scale` (m,)."""
    return error / (1.0 + np.sqrt(np.sum((scale * error) ** 2)))


@njit(cache=True)
def task_force(observer: int, task: TaskSpace, e: TaskError, estimate: Array, v: Array, gains: TaskGains) -> TaskForce:
    """Return the task force Λ_x(ẍ_c − J̇q̇) of a proposition; the closed loop below is exact away from singularities.

    - TASK_ERROR (41): Λ_x s' + (μ_x + K)s = J_M^{#T}(τ_ext − τ̂), s = x̃' + P x̃.
    - TASK_ERROR_PD (43): Λ_x x̃'' + (μ_x + D)x̃' + K x̃ = J_M^{#T}(τ_ext − τ̂); NONE: the same with τ̂ = 0.
    - MOMENTUM (46): x̃'' + K_v x̃' + K_p x̃ = Λ_x⁻¹J_M^{#T}(τ_ext − τ̂) with τ̂ = −r.

    Desired accelerations are added to the printed laws for constant targets. K and D enter as `sampled_damping`.

    Parameters
    ----------
    observer : int
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
    feedforward = e.acceleration - apply(task.Jdot, v)
    compensation, idle = apply(task.J_inv.T, estimate), np.zeros(len(v))
    if observer == TASK_ERROR:
        s = e.velocity + gains.P * e.error
        force = apply(task.Lambda, feedforward + gains.P * e.error_rate) + task_coriolis(task, s)
        force += sampled_damping(gains.K, task.Lambda, gains.period, s)
        return TaskForce(force, compensation, apply(task.J_inv, s))
    if observer == MOMENTUM:
        force = apply(task.Lambda, feedforward + gains.K_v * e.velocity + gains.K_p * e.error)
        return TaskForce(force, compensation, idle)
    force = apply(task.Lambda, feedforward) + task_coriolis(task, e.velocity) + gains.K_x * e.error
    force += sampled_damping(gains.D, task.Lambda, gains.period, e.velocity)
    if observer == NONE:
        return TaskForce(force, np.zeros(len(compensation)), idle)
    s = e.velocity + gains.gamma * saturated(e.error, gains.scale)
    return TaskForce(force, compensation, apply(task.J_inv, s))


@njit(cache=True)
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
    pull = stiffness * q_error - sampled_damping(damping, M, period, task.v_null)
    return project(task, pull + velocity_torque(task))


@njit(cache=True)
def frame_state(parent, mass, com, inertia, S, V, R_WL, p_WL, M, v, link, R_LE, p_LE, max_mass) -> FrameState:
    """Return the state of frame E, fixed in a link at (R_LE, p_LE), of a tree whose kinematics are known.

    Its task has the dimension of `max_mass` (m,); the other arguments are those of `tree_dynamics`.
    """
    m = len(max_mass)
    J, Jdot = frame_jacobian(parent, S, V, R_WL, p_WL, link, p_LE)
    C = coriolis_matrix(parent, mass, com, inertia, R_WL, p_WL, S, V)
    task = task_space(J[6 - m :], Jdot[6 - m :], M, C, v, max_mass)
    return FrameState(task, product(R_WL[link], R_LE), p_WL[link] + apply(R_WL[link], p_LE), apply(J, v))


@njit(cache=True)
def command_terms(
    parent, mass, com, inertia, S, V, R_WL, p_WL, M, Cv, g, q, v, link, R_LE, p_LE, max_mass, R_d, p_d, V_d, A_d,
    offset, speed, observer, estimate, gains, yielding, yield_damping, q_d, stiffness, damping,
):  # fmt: skip
    """Return the named parts (5, n) of the torque command, the task error (m,) and the drive of the observer (n,).

    Parameters
    ----------
    parent, mass, com, inertia, S, V, R_WL, p_WL, M, v, link, R_LE, p_LE, max_mass :
        As in `frame_state`.
    Cv, g, q : (n,) arrays
        C q̇, gravity torque and joint positions.
    R_d, p_d, V_d, A_d : (3, 3), (3,), (6,) and (6,) arrays
        Desired pose, velocity and acceleration of the frame, in the world.
    offset, speed : (6,) and (2,) arrays
        Where the target is beside the desired pose (rad, m), and how fast it comes back; see `advance_offset`.
    observer, estimate, gains :
        As in `task_force`.
    yielding : float
        From 0 (the task is kept) to 1 (damping alone, of `yield_damping` in 1/s).
    q_d, stiffness, damping : (n,) arrays
        Rest posture and impedance of the body, as in `null_space_torque`.
    """
    now = frame_state(parent, mass, com, inertia, S, V, R_WL, p_WL, M, v, link, R_LE, p_LE, max_mass)
    task, m = now.task, len(max_mass)
    error = task_error(now.R, now.p, now.V, R_d, p_d, V_d, A_d, m).error
    R_t, p_t, V_t = product(rotation_exp(offset[:3]), R_d), p_d + offset[3:], V_d.copy()
    V_t[:3] += toward_zero(offset[:3], speed[0])
    V_t[3:] += toward_zero(offset[3:], speed[1])
    e = task_error(now.R, now.p, now.V, R_t, p_t, V_t, A_d, m)
    force = task_force(observer, task, e, estimate, v, gains)
    loose = -apply(task.Lambda, apply(task.Jdot, v) + yield_damping * now.V[6 - m :])
    keep = 1.0 - yielding
    terms = np.empty((5, len(q)))
    terms[0] = apply(task.J.T, keep * force.task + yielding * loose)
    terms[1] = apply(task.J.T, keep * force.compensation)
    terms[2] = null_space_torque(task, q_d - q, M, stiffness, damping, gains.period)
    terms[3], terms[4] = Cv, g
    return terms, error, force.drive
