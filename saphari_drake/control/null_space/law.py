"""Laws of Section 5, compiled: task error, task force of Propositions 1 to 3, null-space torque, the whole command."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.control.null_space.parameters import Observer
from saphari_drake.math.products import apply, product
from saphari_drake.math.rotations import rotation_exp, rotation_log, rotation_rate
from saphari_drake.math.task_space import (
    TaskSpace,
    project,
    sampled_damping,
    task_coriolis,
    task_space,
    velocity_torque,
)
from saphari_drake.math.tree_matrices import coriolis_matrix, frame_jacobian, world_point

Array = NDArray[np.float64]
# s; time constants of a target that follows the frame while the task yields, and starts and ends its return; m, rad.
FOLLOWING, STARTING, SETTLING, NEAR = 0.05, 0.25, 0.15, 1e-7


class Frame(NamedTuple):
    """The controlled frame E, fixed in a link; its task has the dimension m of `max_mass`."""

    link: int
    R_LE: Array  # (3, 3)
    p_LE: Array  # (3,) m
    max_mass: Array  # (m,) kg m², kg; largest effective inertia, see `task_space`


class JointState(NamedTuple):
    """Joint positions and velocities, and the terms of the dynamics there."""

    q: Array  # (n,)
    v: Array  # (n,)
    M: Array  # (n, n)
    Cv: Array  # (n,) and what viscous friction takes
    g: Array  # (n,)


class FrameState(NamedTuple):
    """Motion of the frame in the world, and the task space of its position (m = 3) or pose (m = 6)."""

    task: TaskSpace
    R: Array  # (3, 3)
    p: Array  # (3,) m
    V: Array  # (6,) [ω; v]


class Desired(NamedTuple):
    """Desired motion of the frame in the world, and the rest posture of the body."""

    R: Array  # (3, 3)
    p: Array  # (3,) m
    V: Array  # (6,) [ω; v]
    A: Array  # (6,) time derivative of V
    q: Array  # (n,)


class Yielding(NamedTuple):
    """What the law remembers of having yielded."""

    share: float  # from 0 (the task is kept) to 1 (damping alone)
    offset: Array  # (6,) of the target from the desired pose (rad, m)
    speed: Array  # (2,) at which it comes back (rad/s, m/s), see `advance_offset`


class TaskError(NamedTuple):
    """Error of the task, in the world."""

    error: Array  # (m,) x̃: log(R_d Rᵀ)^∨ (rad), x_d − x (m)
    velocity: Array  # (m,) x_d' − x', desired minus actual velocity
    error_rate: Array  # (m,) time derivative of `error`; differs from `velocity` for large rotations
    acceleration: Array  # (m,) desired acceleration


class Gains(NamedTuple):
    """Gains of a task of dimension m and of the body; what the observer does not use may have any value."""

    observer: int  # an `Observer`; as a plain number, since numba is slow to recognise a member
    P: Array  # (m,) 1/s, Proposition 1
    K: Array  # (m,) Ns/m, Nms/rad, Proposition 1
    D: Array  # (m,) Ns/m, Nms/rad, Proposition 2
    K_x: Array  # (m,) N/m, Nm/rad, Proposition 2
    gamma: float  # 1/s, Proposition 2
    K_v: Array  # (m,) 1/s, Proposition 3
    K_p: Array  # (m,) 1/s², Proposition 3
    scale: Array  # (m,) 1, or m/rad: length that makes rotation comparable
    stiffness: Array  # (n,) Nm/rad, N/m; diagonal of the body's K_p
    damping: Array  # (n,) Nms/rad, Ns/m; diagonal of the body's B
    yield_damping: float  # 1/s; damping over inertia of a task that yields
    period: float  # s


class TaskForce(NamedTuple):
    """Generalized force (m,) of the task, in the parts that are named in the torque."""

    task: Array  # feedback and feedforward
    compensation: Array  # against the estimated external torque
    drive: Array  # (n,) what the disturbance observer integrates


@njit(cache=True)
def frame_state(tree, motion, v: Array, M: Array, frame: Frame) -> FrameState:
    """Return the state of a frame of a `Tree` that moves as `motion`, with joint velocity v (n,) and inertia M."""
    m = len(frame.max_mass)
    J, Jdot = frame_jacobian(motion, frame.link, frame.p_LE)
    task = task_space(J[6 - m :], Jdot[6 - m :], M, coriolis_matrix(tree, motion), v, frame.max_mass)
    R = product(motion.R_WL[frame.link], frame.R_LE)
    return FrameState(task, R, world_point(motion, frame.link, frame.p_LE), apply(J, v))


@njit(cache=True)
def task_error(now: FrameState, desired: Desired) -> TaskError:
    """Return the error of a frame from its desired motion."""
    m = len(now.task.J)
    velocity = desired.V[6 - m :] - now.V[6 - m :]
    error, rate = np.empty(m), velocity.copy()
    error[m - 3 :] = desired.p - now.p
    if m == 6:
        error[:3] = rotation_log(product(desired.R, now.R.T))
        rate[:3] = rotation_rate(error[:3], desired.V[:3], now.V[:3])
    return TaskError(error, velocity, rate, desired.A[6 - m :])


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
def saturated(error: Array, scale: Array) -> Array:
    """Return f(x̃) = x̃ / (1 + ‖x̃‖) (44) with the norm in metres: rotation counts by the length `scale` (m,)."""
    return error / (1.0 + np.sqrt(np.sum((scale * error) ** 2)))


@njit(cache=True)
def task_force(task: TaskSpace, e: TaskError, estimate: Array, v: Array, gains: Gains) -> TaskForce:
    """Return the task force Λ_x(ẍ_c − J̇q̇) of a proposition; the closed loop below is exact away from singularities.

    - TASK_ERROR (41): Λ_x s' + (μ_x + K)s = J_M^{#T}(τ_ext − τ̂), s = x̃' + P x̃.
    - TASK_ERROR_PD (43): Λ_x x̃'' + (μ_x + D)x̃' + K x̃ = J_M^{#T}(τ_ext − τ̂); NONE: the same with τ̂ = 0.
    - MOMENTUM (46): x̃'' + K_v x̃' + K_p x̃ = Λ_x⁻¹J_M^{#T}(τ_ext − τ̂) with τ̂ = −r.

    Desired accelerations are added to the printed laws for constant targets. K and D enter as `sampled_damping`.

    `estimate` (n,) is τ̂, the estimated external torque (Nm), and v (n,) the joint velocity.
    """
    feedforward = e.acceleration - apply(task.Jdot, v)
    compensation, idle = apply(task.J_inv.T, estimate), np.zeros(len(v))
    if gains.observer == Observer.TASK_ERROR:
        s = e.velocity + gains.P * e.error
        force = apply(task.Lambda, feedforward + gains.P * e.error_rate) + task_coriolis(task, s)
        force += sampled_damping(gains.K, task.Lambda, gains.period, s)
        return TaskForce(force, compensation, apply(task.J_inv, s))
    if gains.observer == Observer.MOMENTUM:
        force = apply(task.Lambda, feedforward + gains.K_v * e.velocity + gains.K_p * e.error)
        return TaskForce(force, compensation, idle)
    force = apply(task.Lambda, feedforward) + task_coriolis(task, e.velocity) + gains.K_x * e.error
    force += sampled_damping(gains.D, task.Lambda, gains.period, e.velocity)
    if gains.observer == Observer.NONE:
        return TaskForce(force, np.zeros(len(compensation)), idle)
    s = e.velocity + gains.gamma * saturated(e.error, gains.scale)
    return TaskForce(force, compensation, apply(task.J_inv, s))


@njit(cache=True)
def null_space_torque(task: TaskSpace, q_error: Array, M: Array, gains: Gains) -> Array:
    """Return the null-space part of τ = M q̈_c + C q̇ + g for (39), without any choice of a basis (n,).

    It is P_cᵀ(K_p q̃ − B Zν − C Zν + J̇ᵀΛ_xẋ − (C + Cᵀ)J_M^#ẋ), equal to M Z(ν̇_c − Ż^#q̇) with B_ν = ZᵀB Z, and gives
    Λ_ν ν̇ + (μ_ν + B_ν)ν = Zᵀ(K_p q̃ − τ_ext) (40). Without a basis there is none that could jump or lose rank.

    Parameters
    ----------
    q_error : (n,) array
        q̃ = q_d − q (rad or m).
    M : (n, n) array
        Inertia matrix.
    gains : Gains
        Of which the diagonals of K_p and B count; B enters as `sampled_damping`, since the last joints of a wrist are
        too light for a damping that suits the others.
    """
    pull = gains.stiffness * q_error - sampled_damping(gains.damping, M, gains.period, task.v_null)
    return project(task, pull + velocity_torque(task))


@njit(cache=True)
def shifted(desired: Desired, memory: Yielding) -> Desired:
    """Return the target: the desired motion with the offset that is left of having yielded."""
    offset, V = memory.offset, desired.V.copy()
    for k in range(2):
        part = offset[3 * k : 3 * k + 3]
        distance = np.sqrt(np.sum(part * part))
        if distance > 0.0:
            V[3 * k : 3 * k + 3] -= memory.speed[k] / distance * part
    return Desired(product(rotation_exp(offset[:3]), desired.R), desired.p + offset[3:], V, desired.A, desired.q)


@njit(cache=True)
def command_terms(
    tree, motion, joints: JointState, frame: Frame, desired: Desired, memory: Yielding, estimate: Array, gains: Gains
) -> tuple[Array, Array, Array]:
    """Return the named parts (5, n) of the torque command, the task error (m,) and the drive of the observer (n,).

    Parameters
    ----------
    tree, motion :
        `Tree` and its `TreeMotion`.
    joints, frame, desired, memory, gains :
        See their classes.
    estimate : (n,) array
        τ̂, the estimated external torque (Nm).
    """
    v, yielding = joints.v, memory.share
    now = frame_state(tree, motion, v, joints.M, frame)
    task, m = now.task, len(now.task.J)
    force = task_force(task, task_error(now, shifted(desired, memory)), estimate, v, gains)
    loose = -apply(task.Lambda, apply(task.Jdot, v) + gains.yield_damping * now.V[6 - m :])
    keep = 1.0 - yielding
    terms = np.empty((5, len(v)))
    terms[0] = apply(task.J.T, keep * force.task + yielding * loose)
    terms[1] = apply(task.J.T, keep * force.compensation)
    terms[2] = null_space_torque(task, desired.q - joints.q, joints.M, gains)
    terms[3], terms[4] = joints.Cv, joints.g
    return terms, task_error(now, desired).error, force.drive
