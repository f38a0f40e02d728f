"""Friction and drives of the joints as they were identified, for observers that are to see a touch behind them."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import diagonal, require_non_negative, require_positive, require_vector
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class JointFrictionParameters:
    """Friction of the joints and error of their drives, as they were identified."""

    # Nm (N), Coulomb, and Nms/rad (Ns/m), viscous friction; one value or one a joint. Viscous, empty: that of the model
    # file. Coulomb friction of the file, `RobotModel.coulomb`, has no part in Drake's plant: give it for a real arm.
    coulomb: list[float] | float = 0.0
    viscous: list[float] | float = field(default_factory=list)
    # Nm (N); constant error of each drive: it gives so much more than it is asked for. Empty: none.
    bias: list[float] = field(default_factory=list)
    # rad (m); way over which friction turns round when a joint does: ten steps of an encoder or more. Assumed.
    turn: float = 1.0e-4
    # Share of the Coulomb friction by which it may be wrong in motion; thresholds of a contact rise by it. Assumed.
    uncertainty: float = 0.3

    def __post_init__(self) -> None:
        require_non_negative(self, "coulomb", "viscous", "uncertainty")
        require_positive(self, "turn")
        require_vector(self, len(self.bias), "bias")


class JointFriction(NamedTuple):
    """Friction of all joints, and what their drives give too much, as arrays (n,)."""

    coulomb: Array
    viscous: Array
    bias: Array
    turn: float
    error: float  # share of the Coulomb friction

    def uncertainty(self, share: Array) -> Array:
        """Return by how much the friction may be wrong (n,): all of it, where a joint has not moved yet."""
        return self.coulomb * (1.0 - (1.0 - min(self.error, 1.0)) * np.abs(share))

    def torque(self, share: Array, v: Array) -> Array:
        """Return what friction does to the joints, (n,), with `share` of the Coulomb friction acting (−1 … 1)."""
        return -(self.coulomb * share + self.viscous * v)

    def after(self, share: Array, way: Array) -> Array:
        """Return the share after a way of the joints (n,) (rad or m).

        dz/dx = (1 − z sgn ẋ)/turn, exactly (Dahl's model of friction): where a joint comes to rest, its last direction
        is remembered. A hand that pushes until the arm stops is then told from the friction that helps to hold it.
        """
        sign = np.sign(way)
        return sign + (share - sign) * np.exp(-np.abs(way) / self.turn)


def joint_friction(params: JointFrictionParameters, robot: RobotModel) -> JointFriction:
    """Return the friction of a robot's joints."""
    coulomb = diagonal(params.coulomb, robot.n, "coulomb")
    viscous = diagonal(params.viscous, robot.n, "viscous") if np.size(params.viscous) else robot.viscous
    bias = np.array(params.bias or [0.0] * robot.n)
    if len(bias) != robot.n:
        raise ParameterError("bias", f"{robot.name} has {robot.n} joints, got {len(bias)} entries")
    return JointFriction(coulomb, viscous, bias, params.turn, params.uncertainty)
