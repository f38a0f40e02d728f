"""Errors of a robot's masses, an unknown tool and offsets, estimated from residuals without contact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.tree import Tree, TreeMotion
from saphari_drake.math.tree_weight import weight_regressor

Array = NDArray[np.float64]


class Learned(NamedTuple):
    """An estimate of what the model lacks, and how sure it is."""

    theta: Array  # (k,) relative errors of the n links' masses, tool (kg and three times kg m), n offsets (Nm)
    covariance: Array  # (k, k)
    limited: bool = False  # something is at its limit


@njit(cache=True)
def sensitivity(motion: TreeMotion, tree: Tree) -> Array:
    """Return H (n, 2n + 4): without contact, and with a residual that does not lag, r = H θ = −W θ_W + b."""
    n = len(tree.mass)
    H = np.zeros((n, 2 * n + 4))
    H[:, : n + 4] = -weight_regressor(motion, tree.mass, tree.com, tree.gravity)
    for i in range(n):
        H[i, n + 4 + i] = 1.0
    return H


def prior(n: int, mass: float, tool_mass: float, tool_offset: float, offset: Array) -> Learned:
    """Return what is known before anything is learned: standard deviations about zero."""
    tool = [tool_mass, *[tool_mass * tool_offset] * 3]
    deviation = np.concatenate([np.full(n, mass), tool, offset])
    return Learned(np.zeros(2 * n + 4), np.diag(deviation**2))


def counted(place: Array, q: Array, least: float) -> Array:
    """Return the position (n,) up to which ways have been counted: it follows q (n,) at no less than `least` (rad)."""
    return np.clip(place, q - least, q + least)


def forgotten(learned: Learned, share: Array, offset: Array) -> Learned:
    """Return the estimate with a share (n,) (0–1) of what is known of each offset lost, up to its prior (n,) (Nm).

    The estimate stays the best guess. It keeps ρ = √(1 − share) of an offset's covariance with all others, and ρ² of
    its own variance beside (1 − ρ²) of the prior's: what was learned of masses and offset together is lost too.
    """
    if not share.any():
        return learned
    n, k = len(share), len(learned.theta)
    rho = np.concatenate([np.ones(k - n), np.sqrt(1.0 - share)])
    P = learned.covariance * np.outer(rho, rho)
    P[range(k - n, k), range(k - n, k)] += share * offset**2
    return learned._replace(covariance=P)


@njit(cache=True)
def learn(learned: Learned, H: Array, r: Array, variance: Array, drift: Array, limits: Array) -> Learned:
    """Return the estimate after one more residual: a step of a Kalman filter, joint after joint.

    Parameters
    ----------
    H, r : (n, k) and (n,) arrays
        What the residual shows, and the residual (Nm).
    variance, drift : (n,) and (k,) arrays
        Of a residual (Nm²), and by how much θ may have changed since the one before.
    limits : (k,) array
        Of |θ|.
    """
    n, k = H.shape
    theta, P = learned.theta.copy(), learned.covariance.copy()
    Ph = np.empty(k)
    for a in range(k):
        P[a, a] += drift[a]
    for i in range(n):
        size, error = variance[i], r[i]
        for a in range(k):
            total = 0.0
            for b in range(k):
                total += P[a, b] * H[i, b]
            Ph[a] = total
            size += H[i, a] * total
            error -= H[i, a] * theta[a]
        for a in range(k):
            theta[a] += Ph[a] * error / size
            for b in range(k):
                P[a, b] -= Ph[a] * Ph[b] / size
    limited = False
    for a in range(k):
        if abs(theta[a]) > limits[a]:
            limited = True
            theta[a] = np.sign(theta[a]) * limits[a]
    return Learned(theta, P, limited)
