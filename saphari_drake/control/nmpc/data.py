"""What the kernels are given: the constants of a problem, and the inputs of one control step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit

Array = NDArray[np.float64]


class HorizonData(NamedTuple):
    """Constants of the problem, as the kernels take them; units m, rad, s."""

    revolute: NDArray[np.int64]  # (n,), 1 or 0
    parent: NDArray[np.int64]  # (n,), −1: the world
    chain: NDArray[np.int64]  # (n, n), ancestors of each link and itself, root first
    depth: NDArray[np.int64]  # (n,), how many these are
    R_PM: Array  # (n, 3, 3), frame M of a joint at q = 0, in the M of its parent
    p_PM: Array  # (n, 3)
    link_E: int  # that carries the end effector
    R_ME: Array  # (3, 3)
    p_ME: Array  # (3,)
    link_C: NDArray[np.int64]  # (points,), that carry the test points
    p_MC: Array  # (points, 3)
    d_min: Array  # (points,)
    c: Array  # (points,), of (20)
    period: float
    Q_v: Array  # (n,)
    Q_q: Array  # (n,)
    Q_e: Array  # (6,), position, orientation
    pull: Array  # (2,) m², rad²; times the sum of three weights, the σ of `pseudo_huber` for position and orientation
    R_q: Array  # (n,)
    R_e: Array  # (6,)
    r_O: float
    home: Array  # (n,)
    q_min: Array  # (n,)
    q_max: Array  # (n,)
    v_max: Array  # (n,)
    change: Array  # (n,), largest change of velocity from one stage to the next; infinite: any
    guard: float  # m²
    cost_on: bool
    rows_on: bool
    swept: bool  # distances of whole intervals instead of their ends
    base: NDArray[np.int64]  # (3,) joints x, y, θ of a platform that cannot slip sideways, or (0,)


class Scene(NamedTuple):
    """What one control step is given, for the stages 0 … N; the reference of stage 0 is not used."""

    q0: Array  # (n,), measured positions
    R_ref: Array  # (N + 1, 3, 3)
    p_ref: Array  # (N + 1, 3)
    p_WO: Array  # (N + 1, 3, m), obstacles; coordinates apart, so that kernels work on several at once
    radius: Array  # (m,)
    v0: Array  # (n,), velocity with which the horizon begins


@njit(cache=True)
def no_multipliers(scene, N, points):
    """Return multipliers (N + 1, points, m) of no row, for `horizon.evaluate`."""
    return np.zeros((N + 1, points, scene.radius.shape[0]))
