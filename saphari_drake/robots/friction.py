"""Friction of the joints, as a robot's controllers and observers may know it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
BREAK_AWAY = 0.02  # rad/s or m/s; at slower speeds dry friction is not yet all there. Assumed


@dataclass(frozen=True)
class JointFriction:
    """Coulomb and viscous friction of n joints.

    Attributes
    ----------
    coulomb, viscous : (n,) arrays
        Nm (N), and Nms/rad (Ns/m).
    """

    coulomb: Array
    viscous: Array

    @classmethod
    def none(cls, n: int) -> JointFriction:
        """Return that of n joints without friction."""
        return cls(np.zeros(n), np.zeros(n))

    def torque(self, v: ArrayLike) -> Array:
        """Return what friction takes of the torque, c tanh(q̇/v₀) + d q̇, (n,) in Nm or N.

        Between ± v₀ dry friction rises with the speed, so that what subtracts it does not chatter at rest.
        """
        v = np.asarray(v, dtype=float)
        return self.coulomb * np.tanh(v / BREAK_AWAY) + self.viscous * v
