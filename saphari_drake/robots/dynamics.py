"""The one place that evaluates M, Cq̇, Cᵀq̇, g, Jacobians and J̇q̇ of a state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.math.tree import point_kinematics, tree_dynamics, tree_kinematics
from saphari_drake.messages import Immutable
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class PointKinematics(NamedTuple):
    """Motion of a point C fixed in a link, in the world frame."""

    p_WC: Array  # (3,) position, m
    v_WC: Array  # (3,) velocity, m/s
    Jv_WC: Array  # (3, n) Jacobian, v_WC = Jv_WC q̇
    Jdotv_WC: Array  # (3,) J̇q̇, m/s²


@dataclass(frozen=True)
class DynamicsTerms(Immutable):
    """All terms of M(q)q̈ + C(q,q̇)q̇ + g(q) + τ_ext = τ (6) at one state, evaluated once and shared.

    Attributes
    ----------
    q, v : (n,) arrays
        Joint positions and velocities.
    M : (n, n) array
        Inertia matrix.
    Cv, CTv, g, p : (n,) arrays
        C q̇, Cᵀ q̇ (with Ṁ = C + Cᵀ), gravity torque and momentum M q̇.
    R_WL, p_WL : (n, 3, 3) and (n, 3) arrays
        Poses of the links in the world.
    S, V, A : (n, 6) arrays
        Joint axes, link velocities, and link accelerations for q̈ = 0: spatial [ω; v], at the world origin.
    finite : bool
        Whether the state is known; if not, all of the above is NaN.
    """

    q: Array
    v: Array
    M: Array
    Cv: Array
    CTv: Array
    g: Array
    p: Array
    R_WL: Array
    p_WL: Array
    S: Array
    V: Array
    A: Array
    parent: NDArray[np.int64]
    finite: bool = True

    def unknown(self) -> DynamicsTerms:
        """Return terms of the same sizes for a state that is not known."""
        arrays = {name: np.full_like(value, np.nan) for name, value in vars(self).items() if name not in _CONSTANTS}
        return replace(self, finite=False, **arrays)

    def point(self, link: int, p_LC: Array) -> PointKinematics:
        """Return position, velocity, Jacobian and J̇q̇ of point p_LC (m, link frame) of a link."""
        return PointKinematics(*point_kinematics(self.parent, self.S, self.V, self.A, self.R_WL, self.p_WL, link, p_LC))


_CONSTANTS = ("parent", "finite")


def evaluate_dynamics(robot: RobotModel, q: ArrayLike, v: ArrayLike) -> DynamicsTerms:
    """Evaluate all terms at joint positions `q` and velocities `v`, both (n,).

    Raises
    ------
    StateError
        If a state has the wrong size or is not finite.
    """
    q, v = robot.checked_vector(q, "positions"), robot.checked_vector(v, "velocities")
    t = robot.tree
    R_WL, p_WL, S, V, A = tree_kinematics(t.parent, t.kind, t.axis, t.R_PF, t.p_PF, t.R_ML, t.p_ML, q, v)
    M, Cv, CTv, g, p = tree_dynamics(t.parent, t.mass, t.com, t.inertia, t.armature, t.gravity, R_WL, p_WL, S, V, A, v)
    return DynamicsTerms(q, v, M, Cv, CTv, g, p, R_WL, p_WL, S, V, A, t.parent)


def point_position(robot: RobotModel, q: Array, link: int, p_LC: Array) -> Array:
    """Return the position (3,) in the world of point p_LC of a link at joint positions `q`."""
    t = robot.tree
    R_WL, p_WL, *_ = tree_kinematics(t.parent, t.kind, t.axis, t.R_PF, t.p_PF, t.R_ML, t.p_ML, q, np.zeros(robot.n))
    return np.asarray(p_WL[link] + R_WL[link] @ p_LC)


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
        known = np.isfinite(q).all() and np.isfinite(v).all()
        output.set_value(evaluate_dynamics(self._robot, q, v) if known else self._unknown)
