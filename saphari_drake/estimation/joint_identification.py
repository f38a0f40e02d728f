"""Friction, payload and inertia of an arm by regression, from positions and torques of a periodic motion.

The torque is linear in the unknowns: τ = Σ_j s_j τ_j(q, q̇, q̈) + I_r q̈ + c sign q̇ + d q̇ − b + Y_L (m, m p, I_o).
Positions are fitted by a Fourier series, whose derivatives are exact (Swevers et al., 1997): nothing is differenced.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import StateError
from saphari_drake.math.tree import Tree, tree_dynamics, tree_kinematics
from saphari_drake.robots.corrections import RobotCorrections
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
# What is expected before anything is measured, standard deviations; all assumed: Coulomb (Nm), viscous (Nms/rad), bias
# (Nm), reflected inertia (share), scale of a link, and of a payload: mass (kg), first moments (kg m), inertia (kg m²).
PRIOR = {"coulomb": 20.0, "viscous": 20.0, "bias": 2.0, "rotor": 0.3, "scale": 0.03}
PRIOR_PAYLOAD = np.array([1.0, *[0.1] * 3, *[0.01] * 6])
SIGMA, MEMORY = 0.2, 0.2  # Nm, and s; size of the torque that no parameter explains, as ripple, and how long it lasts
STILL = 0.01  # rad/s or m/s; slower samples are left out: dry friction has no sign there


class Motion(NamedTuple):
    """Positions, velocities and accelerations, (T, n) each."""

    q: Array
    v: Array
    a: Array


class Identification(NamedTuple):
    """What a regression found.

    Attributes
    ----------
    found : RobotCorrections
    delay : float
        By how much torques follow their commands (s), as fits best.
    before, after : (n,) arrays
        Torque that the model does not explain, without and with what was found, root mean square (Nm or N).
    sigma : dict
        Standard deviations of what was found, by the names of `RobotCorrections`.
    """

    found: RobotCorrections
    delay: float
    before: Array
    after: Array
    sigma: dict[str, Array]


def fourier_fit(time: Array, q: Array, period: float, harmonics: int) -> tuple[Array, Array, Array]:
    """Return positions, velocities and accelerations (T, n) of the Fourier series nearest to positions (T, n)."""
    k = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    s, c = np.sin(np.outer(time, k)), np.cos(np.outer(time, k))
    basis = np.hstack([np.ones((len(time), 1)), s, c])
    zero = np.zeros((len(time), 1))
    weights = np.linalg.lstsq(basis, q, rcond=None)[0]
    return (
        basis @ weights,
        np.hstack([zero, k * c, -k * s]) @ weights,
        np.hstack([zero, -(k**2) * s, -(k**2) * c]) @ weights,
    )


def inverse_dynamics(tree: Tree, q: Array, v: Array, a: Array) -> Array:
    """Return M q̈ + C q̇ + g for each row, (T, n)."""
    rows = []
    for q_k, v_k, a_k in zip(q, v, a):
        M, Cv, _, g, _ = tree_dynamics(tree, tree_kinematics(tree, q_k, v_k), v_k)
        rows.append(M @ a_k + Cv + g)
    return np.array(rows)


def regressor(robot: RobotModel, motion: Motion) -> Array:
    """Return the torque of each unknown, (T, n, 5n + 10): coulomb, viscous, −bias, rotor, scale, payload.

    Scales are those of mass and inertia less 1; of rotors, of the file's reflected inertia less 1.
    """
    tree, n, (q, v, a) = robot.file_tree, robot.n, motion
    none = tree._replace(mass=0.0 * tree.mass, inertia=0.0 * tree.inertia, armature=0.0 * tree.armature)
    own = np.eye(n)[None]
    columns = [np.sign(v)[:, :, None] * own, v[:, :, None] * own, -np.ones_like(v)[:, :, None] * own]
    columns.append((a * tree.armature)[:, :, None] * own)
    links = []
    for j in range(n):
        one = np.arange(n) == j
        alone = none._replace(mass=tree.mass * one, inertia=tree.inertia * one[:, None, None])
        links.append(inverse_dynamics(alone, q, v, a))
    return np.concatenate([*columns, np.stack(links, axis=2), np.stack(_payload(none, q, v, a), axis=2)], axis=2)


def _payload(none: Tree, q: Array, v: Array, a: Array) -> list[Array]:
    """Return the torque of a payload's mass, first moments and inertia about the last link's origin."""

    def of(mass: float, com: Array, inertia: Array) -> Array:
        masses, coms, inertias = none.mass.copy(), none.com.copy(), none.inertia.copy()
        masses[-1], coms[-1], inertias[-1] = mass, com, inertia
        return inverse_dynamics(none._replace(mass=masses, com=coms, inertia=inertias), q, v, a)

    zero, weight = np.zeros(3), of(1.0, np.zeros(3), np.zeros((3, 3)))
    # A unit mass at e has the inertia |e|² 1 − e eᵀ about the origin, which is taken out.
    moments = [of(1.0, e, np.outer(e, e) - np.eye(3)) - weight for e in np.eye(3)]
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    units = [np.outer(np.eye(3)[i], np.eye(3)[j]) for i, j in pairs]
    turns = [of(0.0, zero, 0.5 * (E + E.T) if i == j else E + E.T) for E, (i, j) in zip(units, pairs)]
    return [weight, *moments, *turns]


def solve(Y: Array, left: Array, moving: NDArray[np.bool_], sigma: float = SIGMA) -> tuple[Array, Array, Array]:
    """Return the unknowns (p,), their covariance, and the torque (T, n) left over; least squares with a prior.

    Parameters
    ----------
    Y : (T, n, p) array
        Regressor.
    left : (T, n) array
        Torque that the model file does not explain.
    moving : (T, n) bool array
        Samples that count.
    sigma : float
        Standard deviation of a sample (Nm or N), if they were independent.
    """
    n = Y.shape[1]
    prior = np.concatenate([np.repeat(list(PRIOR.values()), n), PRIOR_PAYLOAD])
    A, y = Y[moving], left[moving]
    covariance = np.linalg.inv(A.T @ A / sigma**2 + np.diag(1.0 / prior**2))
    theta = covariance @ (A.T @ y) / sigma**2
    return theta, np.asarray(covariance), np.asarray(left - Y @ theta)


def identify(
    robot: RobotModel,
    time: ArrayLike,
    position: ArrayLike,
    torque: ArrayLike,
    period: float,
    harmonics: int = 20,
    delays: ArrayLike = (0.0,),
) -> Identification:
    """Identify an arm from a motion with whole periods.

    Parameters
    ----------
    time : (T,) array
        Evenly spaced (s).
    position, torque : (T, n) arrays
        Measured positions (rad or m) and commanded torques (Nm or N).
    period : float
        Of the motion (s).
    harmonics : int
        Of the series that is fitted; more than the motion has, for what friction does.
    delays : array
        Delays of the drives (s) to try; the one that explains most is taken.

    Raises
    ------
    StateError
        If sizes differ or numbers are not finite.
    """
    time, position, torque = (np.asarray(x, dtype=float) for x in (time, position, torque))
    if position.shape != (len(time), robot.n) or torque.shape != position.shape:
        raise StateError(f"{robot.name} has {robot.n} joints: {position.shape} positions, {torque.shape} torques")
    if not (np.isfinite(position).all() and np.isfinite(torque).all()):
        raise StateError("positions or torques are not finite")
    q, v, a = fourier_fit(time, position, period, harmonics)
    Y = regressor(robot, Motion(q, v, a))
    explained, moving = inverse_dynamics(robot.file_tree, q, v, a), np.abs(v) > STILL
    sigma_each = SIGMA * float(np.sqrt(max(MEMORY / (time[1] - time[0]), 1.0)))
    tried = []
    for delay in np.atleast_1d(delays):
        left = np.array([np.interp(time - delay, time, column) for column in torque.T]).T - explained
        tried.append((float(delay), left, solve(Y, left, moving, sigma_each)))
    delay, left, (theta, covariance, rest) = min(tried, key=lambda one: float(np.mean(one[2][2] ** 2)))
    found, sigma = _told(robot, theta, np.sqrt(np.diag(covariance)))
    before, after = (np.asarray(np.sqrt(np.mean(x**2, axis=0))) for x in (left, rest))
    return Identification(found, delay, before, after, sigma)


def _told(robot: RobotModel, theta: Array, deviation: Array) -> tuple[RobotCorrections, dict[str, Array]]:
    n = robot.n
    coulomb, viscous, bias, rotor, scale = theta[: 5 * n].reshape(5, n)
    mass = max(float(theta[5 * n]), 0.0)
    centre = theta[5 * n + 1 : 5 * n + 4] / mass if mass > 1e-3 else np.zeros(3)
    found = RobotCorrections(
        coulomb=np.maximum(coulomb, 0.0).tolist(),
        viscous=np.maximum(viscous, 0.0).tolist(),
        bias=bias.tolist(),
        rotor_inertia=(np.maximum(1.0 + rotor, 0.0) * robot.file_tree.armature).tolist(),
        link_scale=np.maximum(1.0 + scale, 0.0).tolist(),
        payload=mass,
        payload_centre=centre.tolist(),
    )
    names = ("coulomb", "viscous", "bias", "rotor_inertia", "link_scale")
    return found, dict(zip(names, deviation[: 5 * n].reshape(5, n))) | {"payload": deviation[5 * n : 5 * n + 1]}
