"""Sufficient conditions on the gains of the null-space compliance."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.math.task_space import TaskSpace, task_coriolis
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


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


def gamma_bound_around(
    robot: RobotModel,
    task_at: Callable[[Array, Array], TaskSpace],
    stiffness: Array,
    damping: Array,
    scale: Array,
    region: float,
    samples: int = 40,
) -> float:
    """Return `gamma_bound` over postures around home, in metres, with μ_x for motions along each task direction.

    Parameters
    ----------
    task_at : callable
        Task space at joint positions and velocities.
    stiffness, damping, scale : (m,) arrays
        Diagonals of K and D, and the length that makes each direction a distance (1 or m/rad).
    region : float
        Largest distance of a joint from home (rad or m).
    """
    coriolis, inertia, unit = 0.0, [], np.outer(scale, scale)
    for offset in np.random.default_rng(0).uniform(-1.0, 1.0, (samples, robot.n)) * region:
        q = np.clip(robot.home + offset, robot.q_min, robot.q_max)
        rest = task_at(q, np.zeros(robot.n))
        inertia.append(rest.Lambda / unit)
        for k in range(len(scale)):
            moving = task_at(q, rest.J_inv[:, k] / scale[k])
            mu = np.column_stack([task_coriolis(moving, w) for w in np.eye(len(scale))])
            coriolis = max(coriolis, float(np.linalg.norm(mu / unit, 2)))
    return gamma_bound(np.array(inertia), stiffness / scale**2, damping / scale**2, coriolis)


def require_gamma(gamma: float, bound: float) -> None:
    """Demand γ below its bound, or raise `ParameterError` naming both."""
    if not gamma < bound:
        what = f"must be below {bound:.3g} 1/s for these K_x and D and this arm around its home posture, got {gamma:g}"
        raise ParameterError("gamma", what)
