"""Wheels that cannot slip sideways: the lateral force on a platform whose joints are x, y and θ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.errors import ParameterError
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


def wheel_force(robot: RobotModel, q: Array, v: Array, torque: Array, base: Sequence[int], step: float) -> Array:
    """Return the generalized force (n,) of wheels that roll without lateral slip, over one step of a discrete plant.

    The plant moves by M (v⁺ − v)/h = τ + a λ − C q̇ − g, θ⁺ = θ + h ω⁺, with a = (−sin θ, cos θ, 0, …); λ is such that
    −ẋ⁺ sin θ⁺ + ẏ⁺ cos θ⁺ = 0. That the force acts at θ and the constraint holds at θ⁺ makes it implicit in ω⁺: the
    fixed point converges by the factor h ẋ per round.

    Parameters
    ----------
    q, v : (n,) arrays
        Joint positions and velocities.
    torque : (n,) array
        Torques and forces of the joints (Nm or N).
    base : sequence of 3 ints
        Joints x, y and θ.
    step : float
        h (s).
    """
    x, y, turn = base
    terms = evaluate_dynamics(robot, q, v)
    across = np.zeros(robot.n)
    across[x], across[y] = -np.sin(q[turn]), np.cos(q[turn])
    free, moved = np.linalg.solve(terms.M, np.column_stack([torque - terms.Cv - terms.g, across])).T
    free = v + step * free
    strength = 0.0
    for _ in range(6):
        heading = q[turn] + step * (free[turn] + strength * moved[turn])
        s, c = np.sin(heading), np.cos(heading)
        strength = (free[x] * s - free[y] * c) / (moved[y] * c - moved[x] * s)
    return np.asarray(strength / step * across)


def lateral_slip(heading: Array, velocity: Array, base: Sequence[int]) -> Array:
    """Return −ẋ sin θ + ẏ cos θ (m/s), (T,), for headings (T,) and joint velocities (T, n)."""
    x, y, _ = base
    return np.asarray(-velocity[:, x] * np.sin(heading) + velocity[:, y] * np.cos(heading))


class Wheels(LeafSystem):
    """The force of wheels without lateral slip on a discrete plant.

    .. pydrake_system::

        name: Wheels
        input_ports:
        - state
        - torque
        output_ports:
        - generalized_force

    Ports
    -----
    state : 2n (rad or m, then rad/s or m/s), of the plant.
    torque : n (Nm or N), what its actuators get.
    generalized_force : n, for the plant's applied generalized force.

    Parameters
    ----------
    robot : RobotModel
        The plant holds nothing else that moves, and nothing touches it: its next velocity is computed here.
    base : sequence of str
        Joints x, y and θ of the platform.
    step : float
        Step of the plant (s).
    coulomb, viscous : (n,) arrays, optional
        Friction of the plant's joints (Nm or N, and Nms/rad or Ns/m).
    """

    def __init__(
        self,
        robot: RobotModel,
        base: Sequence[str],
        step: float,
        coulomb: ArrayLike = 0.0,
        viscous: ArrayLike = 0.0,
    ) -> None:
        super().__init__()
        if len(base) != 3:
            raise ParameterError("base", f"needs the joints x, y and theta, got {list(base)}")
        self._robot, self._step = robot, step
        self._friction = np.broadcast_to(coulomb, robot.n), np.broadcast_to(viscous, robot.n)
        self._base = [robot.joint_index(name) for name in base]
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * robot.n))
        self._torque = self.DeclareVectorInputPort("torque", BasicVector(robot.n))
        self.DeclareVectorOutputPort(
            "generalized_force",
            BasicVector(robot.n),
            self._calc,
            prerequisites_of_calc={self._state.ticket(), self._torque.ticket()},
        )

    def _calc(self, context: Context, output: BasicVector) -> None:
        state, n = self._state.Eval(context), self._robot.n
        coulomb, viscous = self._friction
        torque = self._torque.Eval(context) - coulomb * np.sign(state[n:]) - viscous * state[n:]
        output.SetFromVector(wheel_force(self._robot, state[:n], state[n:], torque, self._base, self._step))
