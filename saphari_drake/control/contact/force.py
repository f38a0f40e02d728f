"""Force control of a contact anywhere on the arm, eq. (58)–(60) and (62)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, State

from saphari_drake.control.contact.base import ContactController, inverse_inertia
from saphari_drake.control.contact.force_parameters import ContactForceControlParameters
from saphari_drake.control.contact.gate import ForceGate
from saphari_drake.control.contact.terms import Handover, Law, TorqueTerms, misfit_torque
from saphari_drake.math.saturation import limit_torque
from saphari_drake.math.task_space import consistent_inverse
from saphari_drake.messages import ForceStatus, Immutable, Interaction, InteractionMode
from saphari_drake.parameters import diagonal
from saphari_drake.robots.dynamics import DynamicsTerms, PointKinematics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class ForceGains(NamedTuple):
    """Gains of the law as arrays."""

    K_f: Array  # (3, 3)
    K_d: Array  # (3, 3) Ns/m
    M_d_inv: Array | None  # (3, 3) 1/kg, None for the natural inertia
    K_N: Array  # (n,) 1/s
    misfit_lever: float  # m
    max_effective_mass: float  # kg


def contact_force_torque(
    terms: DynamicsTerms, point: PointKinematics, F: Array, F_d: Array, misfit: Array, gains: ForceGains
) -> tuple[TorqueTerms, Array]:
    """Return the torque of the force control, eq. (62) with the misfit compensated, and the commanded ẍ_c (3,).

    Closed loop, for an exact force estimate: M_d ẍ + K_d ẋ = K_f (F − F_d), and self-motion damped by K_N. The contact
    comes to rest at F = F_d if the person resists like a spring; under a constant force it goes on with
    K_f (F − F_d)/K_d, and so it does along every direction in which F_d asks for a force that nobody gives.

    Corrected: the force error is F̂ − F_d (printed F_d − F̂, with F the force *on* the robot, a positive feedback), and
    the null-space projector is P_c = I − J_{c,M}^# J_c (printed P). Along directions in which the point cannot move,
    Jᵀu = 0: they get no torque.

    Parameters
    ----------
    terms, point :
        Dynamics, and kinematics of the contact point.
    F, F_d : (3,) arrays
        Estimated and desired force of the person on the robot (N, world).
    misfit : (n,) array
        r − J_cᵀF̂, the part of the residual that F does not explain (Nm).
    gains :
        Gains; see `ForceGains`.
    """
    J = point.Jv_WC
    Lambda, _, P_c = consistent_inverse(J, terms.M, gains.max_effective_mass)
    wanted = gains.K_f @ (F - F_d) - gains.K_d @ point.v_WC
    if gains.M_d_inv is None:
        M_inv_JT = np.linalg.solve(terms.M, J.T)
        acceleration, force = J @ (M_inv_JT @ wanted), wanted
    else:
        acceleration = gains.M_d_inv @ wanted
        force = Lambda @ acceleration
    return (
        TorqueTerms(
            J.T @ (force - Lambda @ point.Jdotv_WC),
            -J.T @ F,
            misfit_torque(misfit, F, gains.misfit_lever),
            -terms.M @ (P_c @ (gains.K_N * terms.v)),
            terms.Cv,
            terms.g,
            np.zeros(len(terms.q)),
        ),
        acceleration,
    )


def observable_part(F: Array, unobservable: Array) -> Array:
    """Return F (3,) without its components along unit directions, the columns of `unobservable` (3, 3)."""
    return F - unobservable @ (unobservable.T @ F)


class _Output(NamedTuple):
    terms: TorqueTerms
    torque: Array
    excess: Array
    F_d: Array
    error: Array
    p_WC: Array
    v_WC: Array
    status: ForceStatus
    law: Law
    gate: ForceGate


@dataclass(frozen=True)
class _Memory(Immutable):
    handover: Handover
    gate: ForceGate


_LAWS = {
    ForceStatus.HOLD: "hold",
    ForceStatus.CONTROLLED: "force",
    ForceStatus.PARTIAL: "force",
    ForceStatus.WEAK: "brake",
    ForceStatus.RELEASED: "brake",
    ForceStatus.SPEED_STOP: "brake",
    ForceStatus.UNSEEN: "yield",
    ForceStatus.NO_CAMERA: "yield",
}


class ContactForceController(ContactController):
    """Keeps the force of a contact at a desired size, holds the posture without one.

    .. pydrake_system::

        name: ContactForceController
        input_ports:
        - dynamics
        - interaction
        - contact_force
        - misfit
        - unobservable_directions
        output_ports:
        - torque_commanded
        - torque_excess
        - torque_terms
        - desired_force
        - force_error
        - contact_position
        - contact_velocity
        - force_status
        - stop_velocity

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    interaction : abstract `Interaction`, from `ContactMonitor`.
    contact_force : 3 (N, world), from `ContactForceEstimator`.
    misfit : n (Nm), from `ContactForceEstimator`.
    unobservable_directions : 9, from `ContactForceEstimator`; no force is asked for along them.
    torque_commanded : n (Nm), within the robot's limits.
    torque_excess : n (Nm), what the limits cut off.
    torque_terms : 7n (Nm), the parts of `TorqueTerms` one after the other.
    desired_force : 3 (N, world), F_d, its observable part; zero while no force is controlled.
    force_error : 3 (N, world), F̂ − F_d; zero while no force is controlled.
    contact_position, contact_velocity : 3 (m, m/s, world), of the contact point; zero without one.
    force_status : 1, a `ForceStatus`; says whether the force is controlled, in which directions, or why not.
    stop_velocity : 3 (m/s, world), the velocity for which the speed stop acted; zero without a stop.

    In contact, with ‖F̂‖ above the gate: `contact_force_torque`. Below it, and after the release: braking to rest.
    In hold: `posture_torque` at the latched posture. Yielding, or without a camera: damping, Coriolis and gravity
    terms alone. A change of law makes no jump: the difference is added, and fades. Nothing returns to where it was
    touched: give the monitor a short `return_timeout`, after which the arm holds where it came to rest.

    Speed stop: ‖ẋ_c‖ or ‖ẋ_c + stop_lead ẍ_c‖ near the limit ends the force control in favour of braking, until the
    contact is released. It has to look ahead: 15 N that nobody resists move a light contact at 10 m/s² and more.
    """

    def __init__(self, robot: RobotModel, params: ContactForceControlParameters | None = None) -> None:
        self._params = params = params or ContactForceControlParameters()
        super().__init__(robot, params)
        self.gains = ForceGains(
            np.diag(diagonal(params.K_f, 3, "K_f")),
            np.diag(diagonal(params.K_d, 3, "K_d")),
            inverse_inertia(params),
            diagonal(params.K_N, robot.n, "K_N"),
            params.misfit_lever,
            params.max_effective_mass,
        )
        self._aligned, self._fixed = params.direction == "aligned", np.array(params.fixed_force, dtype=float)
        self._brake_fade = float(np.exp(-params.period / params.brake_time))
        self._unobservable = self.DeclareVectorInputPort("unobservable_directions", BasicVector(9))
        zero, none = np.zeros(robot.n), np.zeros(3)
        hold, status = self._damped(self._terms_at_home, zero), ForceStatus.HOLD
        self._declare_outputs(
            self._evaluate,
            self._update,
            _Output(hold, zero, zero, none, none, none, none, status, ("hold", 0, -1), ForceGate()),
            _Memory(Handover(None, zero, zero), ForceGate()),
            [self._unobservable],
            {
                "desired_force": (3, lambda o: o.F_d),
                "force_error": (3, lambda o: o.error),
                "contact_position": (3, lambda o: o.p_WC),
                "contact_velocity": (3, lambda o: o.v_WC),
                "force_status": (1, lambda o: [float(o.status)]),
                "stop_velocity": (3, lambda o: o.gate.stop_velocity),
            },
        )

    def _evaluate(self, context: Context) -> _Output:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        interaction: Interaction = self._interaction.Eval(context)
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        F, none = self._force.Eval(context), np.zeros(3)
        gate = memory.gate.after(interaction.mode, float(np.linalg.norm(F)), self._params)
        point, F_d, error = None, none, none
        if interaction.mode in (InteractionMode.CONTACT, InteractionMode.RETURN):
            point = terms.point(interaction.contact.link, interaction.contact.p_LC)
        if point is not None and gate.open:
            hidden = self._unobservable.Eval(context).reshape(3, 3).T
            wanted = gate.size * F / np.linalg.norm(F) if self._aligned else self._fixed
            F_d = observable_part(wanted, hidden)
            parts, acceleration = contact_force_torque(terms, point, F, F_d, self._misfit.Eval(context), self.gains)
            status, error = ForceStatus.PARTIAL if np.any(hidden) else ForceStatus.CONTROLLED, F - F_d
            law = (_LAWS[status], interaction.onset, interaction.contact.link)
            parts = memory.handover.into(law, parts)
            acceleration = acceleration + point.Jv_WC @ np.linalg.solve(terms.M, parts.transition)
            gate = gate.checked(point.v_WC, acceleration, self._params)
        if not gate.open:
            F_d, error, status = none, none, gate.status(interaction.mode)
            law = (_LAWS[status], interaction.onset, interaction.contact.link)
            parts = memory.handover.into(law, self._without_force(terms, interaction, law))
        torque, excess = limit_torque(parts.total(), self._robot.tau_max)
        p_WC, v_WC = (none, none) if point is None else (point.p_WC, point.v_WC)
        return _Output(parts, torque, excess, F_d, error, p_WC, v_WC, status, law, gate)

    def _without_force(self, terms: DynamicsTerms, interaction: Interaction, law: Law) -> TorqueTerms:
        if law[0] == "hold":
            return self._held(terms, interaction)
        return self._damped(terms, self._hold_damping if law[0] == "brake" else self._yield_damping)

    def _update(self, context: Context, state: State) -> None:
        now: _Output = self._output.Eval(context)
        fade = self._brake_fade if now.law[0] == "brake" else self._fade
        memory = _Memory(Handover(now.law, now.torque, fade * now.terms.transition), now.gate)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
