"""Impedance and force laws at a contact anywhere on the arm, eq. (52)–(62)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.products import symmetric_eigen
from saphari_drake.math.task_space import consistent_inverse
from saphari_drake.robots.dynamics import DynamicsTerms
from saphari_drake.robots.kinematics import PointKinematics

Array = NDArray[np.float64]


class TorqueTerms(NamedTuple):
    """Named parts (n,) of a torque command (Nm)."""

    task: Array
    force: Array
    misfit: Array
    null_space: Array
    coriolis: Array
    gravity: Array
    friction: Array

    def total(self) -> Array:
        """Return the sum of all parts."""
        return np.sum(self, axis=0)


class ImpedanceGains(NamedTuple):
    """Gains of the law as arrays."""

    K_p: Array  # (3, 3) N/m
    K_d: Array  # (3, 3) Ns/m
    M_d_inv: Array | None  # (3, 3) 1/kg, None for the natural inertia
    K_N: Array  # (n,) 1/s
    misfit_lever: float  # m
    max_effective_mass: float  # kg
    least_effective_mass: float = 0.0  # kg
    least_damping: float = 0.0  # ratio
    return_torque: float | Array = np.inf  # Nm (N)


def eased(Lambda: Array, K: Array, least: float) -> Array:
    """Return a gain (3, 3) that falls with the effective mass Λ (3, 3) of the contact where that is below `least` (kg).

    K/Λ, the rate with which a sampled loop has to keep up, is then no larger than K/least: S K S with the eigenvalues
    of S = min(1, Λ/least)^½. A contact that is heavy enough in all directions has K itself.
    """
    if least == 0.0:
        return K
    mass, U = symmetric_eigen(Lambda)
    if mass[0] >= least:
        return K
    S = (U * np.sqrt(np.clip(mass / least, 0.0, 1.0))) @ U.T
    return np.asarray(S @ K @ S)


def damped(Lambda: Array, K_p: Array, K_d: Array, ratio: float) -> Array:
    """Return a damping (3, 3) that reaches at least `ratio` along each principal direction of Λ (3, 3).

    Where a contact is heavy, as near a singularity, K_d alone lets it swing: ζ = K_d/(2 √(K_p Λ)). Along the unit
    eigenvectors u of Λ with eigenvalue m, uᵀK_d u is raised to 2 ratio √(uᵀK_p u m); what is larger stays.
    """
    if ratio == 0.0:
        return K_d
    mass, U = symmetric_eigen(Lambda)
    stiffness, given = ((U * (K @ U)).sum(axis=0) for K in (K_p, K_d))
    missing = np.maximum(2.0 * ratio * np.sqrt(stiffness * np.maximum(mass, 0.0)) - given, 0.0)
    return np.asarray(K_d + (U * missing) @ U.T)


def contact_impedance_torque(
    terms: DynamicsTerms,
    point: PointKinematics,
    p_desired: Array,
    F: Array,
    misfit: Array,
    gains: ImpedanceGains,
    q_return: Array | None = None,
) -> TorqueTerms:
    """Return the torque of the contact impedance, eq. (61), with the misfit compensated.

    Closed loop, for an exact force estimate: M_d ẍ + K_d ẋ + K_p (x − x_d) = F, and self-motion damped by K_N; with the
    natural inertia the gains are those of `damped` and `eased`.
    With M J_M^# = J_cᵀ Λ the force enters as J_cᵀ(Λ M_d⁻¹ − I) F̂, which is zero for the natural inertia M_d = Λ (57).
    Corrected: the null-space projector is P_c = I − J_{c,M}^# J_c (printed P).

    Added: `misfit_torque`; a large M_d turns the misfit into a wrong deflection. Where nobody touches any more, the
    residual is friction and what the model lacks: all of it is cancelled, up to a bound, and nothing shaped, so that
    the contact returns to where it was. At rest this is an integral: what friction holds is added, until it gives way.
    Self-motion goes back as well, critically damped by K_N: near a singularity of the contact it is what moves it.

    Parameters
    ----------
    terms, point :
        Dynamics, and kinematics of the contact point.
    p_desired : (3,) array
        x_d in the world (m), constant.
    F : (3,) array
        Force of the person on the robot (N, world).
    misfit : (n,) array
        r − J_cᵀF̂, the part of the residual that F does not explain (Nm).
    gains :
        Gains; see `ImpedanceGains`.
    q_return : (n,) array, optional
        Posture to go back to when nobody touches any more (rad or m).
    """
    J, touched = point.Jv_WC, q_return is None
    Lambda, _, P_c = consistent_inverse(J, terms.M, gains.max_effective_mass)
    K_p, K_d = gains.K_p, gains.K_d
    if gains.M_d_inv is None:
        K_d = damped(Lambda, K_p, K_d, gains.least_damping)
        K_p, K_d = (eased(Lambda, K, gains.least_effective_mass) for K in (K_p, K_d))
    spring = K_p @ (p_desired - point.p_WC) - K_d @ point.v_WC
    force = np.zeros(len(terms.q))
    if gains.M_d_inv is not None:
        shaping = Lambda @ gains.M_d_inv
        spring = shaping @ spring
        force = J.T @ (shaping @ F - F) if touched else force
    task = J.T @ (spring - Lambda @ point.Jdotv_WC)
    if touched:
        compensation = misfit_torque(misfit, F, gains.misfit_lever)
    else:
        compensation = -np.clip(misfit + J.T @ F, -gains.return_torque, gains.return_torque)
    away = 0.0 * terms.q if q_return is None else terms.q - q_return
    null_space = -terms.M @ (P_c @ (gains.K_N * (terms.v + 0.25 * gains.K_N * away)))
    return TorqueTerms(task, force, compensation, null_space, terms.Cv, terms.g, 0.0 * terms.g)


class ForceGains(NamedTuple):
    """Gains of the law as arrays."""

    K_f: Array  # (3, 3)
    K_d: Array  # (3, 3) Ns/m
    M_d_inv: Array | None  # (3, 3) 1/kg, None for the natural inertia
    K_N: Array  # (n,) 1/s
    misfit_lever: float  # m
    max_effective_mass: float  # kg
    least_effective_mass: float = 0.0  # kg


def contact_force_torque(
    terms: DynamicsTerms, point: PointKinematics, F: Array, F_d: Array, misfit: Array, gains: ForceGains
) -> tuple[TorqueTerms, Array]:
    """Return the torque of the force control, eq. (62) with the misfit compensated, and the commanded ẍ_c (3,).

    Closed loop, for an exact force estimate: M_d ẍ + K_d ẋ = K_f (F − F_d), and self-motion damped by K_N. The contact
    comes to rest at F = F_d if the person resists like a spring; under a constant force it goes on with
    K_f (F − F_d)/K_d, and so it does along every direction in which F_d asks for a force that nobody gives.

    Corrected: the force error is F̂ − F_d (printed F_d − F̂, with F the force *on* the robot, a positive feedback), and
    the null-space projector is P_c = I − J_{c,M}^# J_c (printed P). Along directions in which the point cannot move,
    Jᵀu = 0: they get no torque.

    Parameters
    ----------
    terms, point :
        Dynamics, and kinematics of the contact point.
    F, F_d : (3,) arrays
        Estimated and desired force of the person on the robot (N, world).
    misfit : (n,) array
        r − J_cᵀF̂, the part of the residual that F does not explain (Nm).
    gains :
        Gains; see `ForceGains`.
    """
    J = point.Jv_WC
    Lambda, _, P_c = consistent_inverse(J, terms.M, gains.max_effective_mass)
    K_f, K_d = gains.K_f, gains.K_d
    if gains.M_d_inv is None:
        K_f, K_d = (eased(Lambda, K, gains.least_effective_mass) for K in (K_f, K_d))
    wanted = K_f @ (F - F_d) - K_d @ point.v_WC
    if gains.M_d_inv is None:
        M_inv_JT = np.linalg.solve(terms.M, J.T)
        acceleration, force = J @ (M_inv_JT @ wanted), wanted
    else:
        acceleration = gains.M_d_inv @ wanted
        force = Lambda @ acceleration
    return (
        TorqueTerms(
            J.T @ (force - Lambda @ point.Jdotv_WC),
            -J.T @ F,
            misfit_torque(misfit, F, gains.misfit_lever),
            -terms.M @ (P_c @ (gains.K_N * terms.v)),
            terms.Cv,
            terms.g,
            0.0 * terms.g,
        ),
        acceleration,
    )


def observable_part(F: Array, unobservable: Array) -> Array:
    """Return F (3,) without its components along unit directions, the columns of `unobservable` (3, 3)."""
    return F - unobservable @ (unobservable.T @ F)


def pressing_direction(F: Array, inward: Array, share: float) -> Array:
    """Return the direction (3,) of a force, leaning from a surface's inward normal by at most a share of it.

    Parameters
    ----------
    F : (3,) array
        Force, not zero (N).
    inward : (3,) array
        Unit normal into the surface; zero: not known, and nothing is bounded.
    share : float
        Largest tangential part over the normal one.
    """
    along = float(inward @ F)
    across = F - along * inward
    size = float(np.linalg.norm(across))
    direction = F
    if np.any(inward) and size > share * along:
        direction = inward + share * across / size
    return direction / np.linalg.norm(direction)


def misfit_torque(misfit: Array, F: Array, lever: float) -> Array:
    """Return −(r − J_cᵀF̂), each joint bounded by `lever` ‖F̂‖ (n,).

    It is zero for a force at the assumed point. A point that is wrong by some millimetres leaves a steady torque, which
    the law at the contact opposes in the null space by damping alone, so that a light wrist turns away under the hand.

    Parameters
    ----------
    misfit : (n,) array
        r − J_cᵀF̂, the part of the residual that the estimated force does not explain (Nm).
    F : (3,) array
        Estimated force (N).
    lever : float
        Error of the contact point that would explain as much (m).
    """
    bound = lever * float(np.linalg.norm(F))
    return np.clip(-misfit, -bound, bound)
