"""Contact force from the residual at a known contact point, with what cannot be observed."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ContactPoint, SystemStatus, status_of
from saphari_drake.parameters import require_positive
from saphari_drake.robots.dynamics import DynamicsInput, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class ContactForceParameters:
    """Truncation of the least squares."""

    # Singular values of J_c below this share of the largest count as zero,
    rcond: float = 0.02
    # and those below this (m): a force with so short a lever arm is lost in the noise of the residual.
    least_lever: float = 0.02
    # Nm, standard deviation of the residual of all joints beside that of their friction. Assumed.
    deviation: float = 0.2

    def __post_init__(self) -> None:
        if not 0.0 < self.rcond < 1.0:
            raise ParameterError("rcond", f"must lie between 0 and 1, got {self.rcond}")
        require_positive(self, "least_lever", "deviation")


class ContactForce(NamedTuple):
    """A contact force and how far it can be trusted."""

    F_W: Array  # (3,) force that the person applies on the robot, world frame, N
    rank: int  # dimensions of the force that the residual determines
    unobservable: Array  # (3, 3) unit directions the residual cannot see as columns, zero columns behind them
    misfit: Array  # (n,) r − J_cᵀF, Nm


def estimate_contact_force(
    J: Array, r: Array, rcond: float, least_lever: float = 1.0e-9, weight: Array | None = None
) -> ContactForce:
    """Return F̂ = (J_cᵀ)^# r, eq. (51), by truncated least squares.

    The printed pseudo-inverse has no bound where J_c loses rank: points of the LWR4's link 3 move on a sphere round
    the shoulder, so a radial force makes no joint torque. Such directions are left out of F̂ and returned.

    Parameters
    ----------
    J : (3, n) array
        Jacobian of the contact point.
    r : (n,) array
        Residual, r ≈ J_cᵀF (Nm).
    rcond : float
        Relative size below which a singular value counts as zero.
    least_lever : float
        Absolute size below which it does (m).
    weight : (n,) array, optional
        Of each joint in the least squares (0–1); default: all alike.
    """
    w = np.ones(len(r)) if weight is None else weight
    U, s, Vt = np.linalg.svd(J * w, full_matrices=False)
    rank = int(np.count_nonzero(s > max(rcond * s[0], least_lever)))
    F_W = U[:, :rank] @ ((Vt[:rank] @ (w * r)) / s[:rank])
    unobservable = np.zeros((3, 3))
    unobservable[:, : 3 - rank] = U[:, rank:]
    return ContactForce(F_W, rank, unobservable, r - J.T @ F_W)


class ContactForceEstimator(LeafSystem):
    """Estimates the force of one contact by eq. (51).

    .. pydrake_system::

        name: ContactForceEstimator
        input_ports:
        - dynamics
        - torque_external
        - contact_point
        - friction_uncertainty
        output_ports:
        - contact_force
        - rank
        - unobservable_directions
        - misfit
        - system_status

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    torque_external : n (Nm), r ≈ J_cᵀF, from `MomentumObserver`.
    contact_point : abstract `ContactPoint`.
    friction_uncertainty : n (Nm), from `MomentumObserver`; optional: joints whose friction hides more count less.
    contact_force : 3 (N, world), force of the person on the robot; zero without a contact point.
    rank : 1, number of force directions that are determined; 3 is a full estimate, 0 none.
    unobservable_directions : 9, a 3×3 matrix by columns: unit vectors (world) along which the force is not known.
    misfit : n (Nm), the part of the residual that no force at this point explains.
    system_status : 1, a `SystemStatus`; while it is BAD_INPUT, force and misfit are NaN and the rank is 0.
    """

    def __init__(self, robot: RobotModel, params: ContactForceParameters | None = None) -> None:
        super().__init__()
        self._params = params or ContactForceParameters()
        terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        terms.point(0, np.zeros(3))
        self._dynamics = DynamicsInput(self, terms)
        self._torque = self.DeclareVectorInputPort("torque_external", BasicVector(robot.n))
        self._point = self.DeclareAbstractInputPort("contact_point", AbstractValue.Make(ContactPoint()))
        self._friction = self.DeclareVectorInputPort("friction_uncertainty", BasicVector(robot.n))
        none = ContactForce(np.zeros(3), 0, np.eye(3), np.zeros(robot.n))
        inputs = {self.all_input_ports_ticket()}
        estimate = declare_cache(self, "contact force", none, self._estimate, inputs)
        declare_readouts(
            self,
            estimate,
            {
                "contact_force": (3, lambda e: e.F_W),
                "rank": (1, lambda e: [float(e.rank)]),
                "unobservable_directions": (9, lambda e: e.unobservable.T.ravel()),
                "misfit": (robot.n, lambda e: e.misfit),
                "system_status": (1, lambda e: [status_of(e.misfit)]),
            },
        )

    def _estimate(self, context: Context) -> ContactForce:
        point: ContactPoint = self._point.Eval(context)
        r, terms = np.array(self._torque.Eval(context)), self._dynamics.Eval(context)
        on_robot = point.usable(len(r)) or not point.found
        if not (terms.finite and on_robot and status_of(r) == SystemStatus.OK):
            return ContactForce(np.full(3, np.nan), 0, np.eye(3), np.full(len(r), np.nan))
        if not point.found:
            return ContactForce(np.zeros(3), 0, np.eye(3), r)
        J = terms.point(point.link, point.p_LC).Jv_WC
        p, weight = self._params, None
        if self._friction.HasValue(context):
            weight = 1.0 / np.hypot(p.deviation, self._friction.Eval(context))
            weight /= np.max(weight)
        return estimate_contact_force(J, r, p.rcond, p.least_lever, weight)
