"""Laws of a robot that is left without the command of a controller: hold, give way a little, come to rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.robots.dynamics import DynamicsTerms

Array = NDArray[np.float64]
BORDER = 0.2  # share of the travel over which the damping rises to that of the held posture


def posture_torque(terms: DynamicsTerms, q_desired: Array, stiffness: Array, damping: Array) -> Array:
    """Return the computed torque M(K(q_d − q) − D q̇) + C q̇ + g, with K in 1/s² and D in 1/s, (n,).

    Closed loop without other forces: q̈ = K (q_d − q) − D q̇, each joint for itself.
    """
    return terms.M @ (stiffness * (q_desired - terms.q) - damping * terms.v) + terms.Cv + terms.g


class Yield(NamedTuple):
    """Gains of a robot that gives way; (n,) each."""

    stiffness: Array  # 1/s²
    damping: Array  # 1/s
    travel: Array  # rad or m
    hold_stiffness: Array  # 1/s²
    hold_damping: Array  # 1/s


def yield_torque(terms: DynamicsTerms, q_felt: Array, gains: Yield) -> Array:
    """Return the torque of a soft spring about the posture where a touch was felt, stiff beyond the travel (n,).

    Up to the travel of a joint q̈ = K_y (q_f − q) − D_y q̇; what is beyond it is pulled back as a held posture is.
    """
    error = q_felt - terms.q
    beyond = error - np.clip(error, -gains.travel, gains.travel)
    share = np.minimum(np.abs(beyond) / (BORDER * gains.travel), 1.0)
    damping = gains.damping + share * np.maximum(gains.hold_damping - gains.damping, 0.0)
    pull = gains.stiffness * (error - beyond) + gains.hold_stiffness * beyond - damping * terms.v
    return terms.M @ pull + terms.Cv + terms.g


class Coasting(NamedTuple):
    """What is known of a robot whose state is lost: the last one that was known, and the speed that is left of it."""

    M: Array  # (n, n)
    g: Array  # (n,)
    v: Array  # (n,)

    def torque(self, damping: Array) -> Array:
        """Return the weight, and what takes the momentum out: q̇ = −D q̇ foreseen from the last known velocity (n,)."""
        return self.g - self.M @ (damping * self.v)

    def after(self, damping: Array, period: float) -> Coasting:
        """Return the same a period later."""
        return self._replace(v=(1.0 - np.minimum(damping * period, 1.0)) * self.v)
