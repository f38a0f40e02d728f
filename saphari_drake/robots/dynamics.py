"""The one place that evaluates M, Cq̇, Cᵀq̇ and g of a state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DependencyTicket, LeafSystem

from saphari_drake.math.products import all_finite
from saphari_drake.math.tree import tree_state
from saphari_drake.robots.kinematics import Kinematics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DynamicsTerms(Kinematics):
    """All terms of M(q)q̈ + C(q,q̇)q̇ + g(q) + τ_ext = τ (6) at one state, evaluated once and shared.

    Attributes
    ----------
    q, v : (n,) arrays
        Joint positions and velocities.
    M : (n, n) array
        Inertia matrix.
    Cv, CTv, g, p : (n,) arrays
        C q̇, Cᵀ q̇ (with Ṁ = C + Cᵀ), gravity torque and momentum M q̇.
    finite : bool
        Whether the state is known; if not, all of the above, and the kinematics, are NaN.
    """

    q: Array
    v: Array
    M: Array
    Cv: Array
    CTv: Array
    g: Array
    p: Array
    finite: bool = True

    def with_gravity(self, g: Array) -> DynamicsTerms:
        """Return the same terms with another gravity torque (n,)."""
        other = object.__new__(type(self))  # a fifth of the time that dataclasses.replace takes
        vars(other).update(vars(self), g=g)
        return other

    def unknown(self) -> DynamicsTerms:
        """Return terms of the same sizes for a state that is not known."""
        arrays = {name: np.full_like(x, np.nan) for name, x in vars(self).items() if name not in ("parent", "finite")}
        return replace(self, finite=False, **arrays)


def evaluate_dynamics(robot: RobotModel, q: ArrayLike, v: ArrayLike) -> DynamicsTerms:
    """Evaluate all terms at joint positions `q` and velocities `v`, both (n,).

    Raises
    ------
    StateError
        If a state has the wrong size or is not finite.
    """
    return _terms(robot, robot.checked_vector(q, "positions"), robot.checked_vector(v, "velocities"))


def _terms(robot: RobotModel, q: Array, v: Array) -> DynamicsTerms:
    R_WL, p_WL, S, V, A, *terms = tree_state(robot.tree, q, v)
    return DynamicsTerms(R_WL, p_WL, S, V, A, robot.tree.parent, q, v, *terms)


class DynamicsInput:
    """The input port `dynamics` of a system; what is of a robot with other joints counts as not known.

    Parameters
    ----------
    system : LeafSystem
        Gets the port.
    terms : DynamicsTerms
        Of any state of its robot.
    """

    def __init__(self, system: LeafSystem, terms: DynamicsTerms) -> None:
        self._port = system.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._unknown = terms.unknown()

    def Eval(self, context: Context) -> Any:
        """Return the terms of a Context."""
        terms: DynamicsTerms = self._port.Eval(context)
        return terms if terms.M.shape == self._unknown.M.shape else self._unknown

    def ticket(self) -> DependencyTicket:
        """Return the port's ticket."""
        return self._port.ticket()


class RobotDynamics(LeafSystem):
    """Evaluates the dynamics of a measured state once, for all systems that need them.

    .. pydrake_system::

        name: RobotDynamics
        input_ports:
        - position_measured
        - velocity_measured
        output_ports:
        - dynamics

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    velocity_measured : n (rad/s or m/s), from a joint sensor.
    dynamics : abstract `DynamicsTerms` of that state; not `finite` while it, or an input, is not.
    """

    def __init__(self, robot: RobotModel) -> None:
        super().__init__()
        self._robot = robot
        position = self.DeclareVectorInputPort("position_measured", BasicVector(robot.n))
        velocity = self.DeclareVectorInputPort("velocity_measured", BasicVector(robot.n))
        self._ports = position, velocity
        # Evaluated here once, which compiles the kernels before the first control step.
        initial = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        self._unknown = initial.unknown()
        self.DeclareAbstractOutputPort(
            "dynamics",
            alloc=lambda: AbstractValue.Make(initial),
            calc=self._calc,
            prerequisites_of_calc={position.ticket(), velocity.ticket()},
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        q, v = (port.Eval(context) for port in self._ports)
        known = all_finite(q) and all_finite(v)
        output.set_value(_terms(self._robot, q, v) if known else self._unknown)
