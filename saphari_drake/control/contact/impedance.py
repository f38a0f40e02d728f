"""Impedance control of a contact anywhere on the arm, eq. (52)–(57) and (61)."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, State

from saphari_drake.control.contact.base import ContactController, inverse_inertia
from saphari_drake.control.contact.terms import Handover, Law, TorqueTerms, misfit_torque
from saphari_drake.math.saturation import limit_torque
from saphari_drake.math.task_space import consistent_inverse
from saphari_drake.messages import Interaction, InteractionMode
from saphari_drake.parameters import diagonal, positive_definite, require_non_negative, require_positive
from saphari_drake.robots.dynamics import DynamicsTerms, PointKinematics, point_position
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class ContactImpedanceParameters:
    """Impedance at the contact, and the behaviour without one. Gains: the deliverable, unless marked."""

    # N/m, stiffness at the contact along the world's axes; one value or three.
    K_p: list[float] | float = 500.0
    # Ns/m, damping at the contact along the world's axes; one value or three.
    K_d: list[float] | float = 80.0
    # kg, desired inertia along the world's axes; empty: the natural one, eq. (57), which needs no force estimate.
    M_d: list[float] = field(default_factory=list)
    # 1/s, damping of self-motion; one value or one a joint.
    K_N: list[float] | float = 20.0
    # m; the part of the residual that the estimated force does not explain is compensated up to this lever arm times
    # that force, which is what a contact point that is wrong by as much explains. 0: none, as in the deliverable. A.
    misfit_lever: float = 0.03
    # 1/s², stiffness over inertia of the held posture; one value or one a joint. A.
    hold_stiffness: list[float] | float = 225.0
    # 1/s, damping over inertia of the held posture. A.
    hold_damping: list[float] | float = 30.0
    # 1/s, damping over inertia while yielding or stopping. A.
    yield_damping: list[float] | float = 10.0
    # s, time constant with which the torque of the mode that was left fades. A.
    transition_time: float = 0.1
    # kg, bound of the effective mass near singular directions of the contact. A.
    max_effective_mass: float = 50.0
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        for name in ("K_p", "K_d"):
            diagonal(getattr(self, name), 3, name)
        for name in ("K_N", "hold_stiffness", "hold_damping", "yield_damping"):
            value = getattr(self, name)
            diagonal(value, np.size(value), name)
        if len(self.M_d):
            positive_definite(self.M_d, 3, "M_d")
        require_non_negative(self, "misfit_lever")
        require_positive(self, "transition_time", "max_effective_mass", "period")


class ImpedanceGains(NamedTuple):
    """Gains of the law as arrays."""

    K_p: Array  # (3, 3) N/m
    K_d: Array  # (3, 3) Ns/m
    M_d_inv: Array | None  # (3, 3) 1/kg, None for the natural inertia
    K_N: Array  # (n,) 1/s
    misfit_lever: float  # m
    max_effective_mass: float  # kg


def contact_impedance_torque(
    terms: DynamicsTerms,
    point: PointKinematics,
    p_desired: Array,
    F: Array,
    misfit: Array,
    gains: ImpedanceGains,
) -> TorqueTerms:
    """Return the torque of the contact impedance, eq. (61), with the misfit compensated.

    Closed loop, for an exact force estimate: M_d ẍ + K_d ẋ + K_p (x − x_d) = F, and self-motion damped by K_N.
    With M J_M^# = J_cᵀ Λ the force enters as J_cᵀ(Λ M_d⁻¹ − I) F̂, which is zero for the natural inertia M_d = Λ (57).
    Corrected: the null-space projector is P_c = I − J_{c,M}^# J_c (printed P).

    Added: −(r − J_cᵀF̂), each joint bounded by ``misfit_lever`` ‖F̂‖. It is zero for a force at the assumed point. A
    point that is wrong by some millimetres leaves a steady torque, which (61) opposes in the null space by damping
    alone, so that a light wrist turns away under the hand, and which a large M_d turns into a wrong deflection.

    Parameters
    ----------
    terms, point :
        Dynamics, and kinematics of the contact point.
    p_desired : (3,) array
        x_d in the world (m), constant.
    F : (3,) array
        Force of the person on the robot (N, world).
    misfit : (n,) array
        r − J_cᵀF̂, the part of the residual that F does not explain (Nm).
    gains :
        Gains; see `ImpedanceGains`.
    """
    J = point.Jv_WC
    Lambda, _, P_c = consistent_inverse(J, terms.M, gains.max_effective_mass)
    spring = gains.K_p @ (p_desired - point.p_WC) - gains.K_d @ point.v_WC
    if gains.M_d_inv is None:
        task, force = J.T @ (spring - Lambda @ point.Jdotv_WC), np.zeros(len(terms.q))
    else:
        shaping = Lambda @ gains.M_d_inv
        task = J.T @ (shaping @ spring - Lambda @ point.Jdotv_WC)
        force = J.T @ (shaping @ F - F)
    compensation = misfit_torque(misfit, F, gains.misfit_lever)
    null_space = -terms.M @ (P_c @ (gains.K_N * terms.v))
    return TorqueTerms(task, force, compensation, null_space, terms.Cv, terms.g, np.zeros(len(terms.q)))


class _Output(NamedTuple):
    terms: TorqueTerms
    torque: Array
    excess: Array
    error: Array
    p_WC: Array
    law: Law


_LAWS = {
    InteractionMode.HOLD: "hold",
    InteractionMode.CONTACT: "impedance",
    InteractionMode.RETURN: "impedance",
    InteractionMode.YIELD: "yield",
    InteractionMode.STOP: "yield",
}


class ContactImpedanceController(ContactController):
    """Answers a contact with an impedance, holds the posture without one.

    .. pydrake_system::

        name: ContactImpedanceController
        input_ports:
        - dynamics
        - interaction
        - contact_force
        - misfit
        output_ports:
        - torque_commanded
        - torque_excess
        - torque_terms
        - position_error
        - contact_position

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    interaction : abstract `Interaction`, from `ContactMonitor`.
    contact_force : 3 (N, world), from `ContactForceEstimator`; with the natural inertia, bounds the misfit only.
    misfit : n (Nm), from `ContactForceEstimator`.
    torque_commanded : n (Nm), within the robot's limits.
    torque_excess : n (Nm), what the limits cut off.
    torque_terms : 7n (Nm), the parts of `TorqueTerms` one after the other.
    position_error : 3 (m, world), x_d − x_c during contact and return, else zero.
    contact_position : 3 (m, world), the controlled contact point; zero without one.

    In contact and return: `contact_impedance_torque`, with x_d where the contact point was when the contact began.
    In hold: `posture_torque` at the latched posture. Yielding or stopping: damping, Coriolis and gravity terms alone.
    A change of law makes no jump: the difference is added, and fades with the transition time.
    """

    def __init__(self, robot: RobotModel, params: ContactImpedanceParameters | None = None) -> None:
        params = params or ContactImpedanceParameters()
        super().__init__(robot, params)
        self.gains = ImpedanceGains(
            np.diag(diagonal(params.K_p, 3, "K_p")),
            np.diag(diagonal(params.K_d, 3, "K_d")),
            inverse_inertia(params),
            diagonal(params.K_N, robot.n, "K_N"),
            params.misfit_lever,
            params.max_effective_mass,
        )
        zero, none = np.zeros(robot.n), np.zeros(3)
        hold = self._damped(self._terms_at_home, zero)
        self._declare_outputs(
            self._evaluate,
            self._update,
            _Output(hold, zero, zero, none, none, ("hold", 0, -1)),
            Handover(None, zero, zero),
            [],
            {"position_error": (3, lambda o: o.error), "contact_position": (3, lambda o: o.p_WC)},
        )

    def _evaluate(self, context: Context) -> _Output:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        interaction: Interaction = self._interaction.Eval(context)
        handover: Handover = context.get_abstract_state(int(self._memory)).get_value()
        law = (_LAWS[interaction.mode], interaction.onset, interaction.contact.link)
        error, p_WC = np.zeros(3), np.zeros(3)
        if law[0] == "impedance":
            link, p_LC = interaction.contact.link, interaction.contact.p_LC
            point = terms.point(link, p_LC)
            p_desired = point_position(self._robot, interaction.q_latched, link, p_LC)
            error, p_WC = p_desired - point.p_WC, point.p_WC
            F, misfit = self._force.Eval(context), self._misfit.Eval(context)
            parts = contact_impedance_torque(terms, point, p_desired, F, misfit, self.gains)
        elif law[0] == "hold":
            parts = self._held(terms, interaction)
        else:
            parts = self._damped(terms, self._yield_damping)
        parts = handover.into(law, parts)
        torque, excess = limit_torque(parts.total(), self._robot.tau_max)
        return _Output(parts, torque, excess, error, p_WC, law)

    def _update(self, context: Context, state: State) -> None:
        now: _Output = self._output.Eval(context)
        memory = Handover(now.law, now.torque, self._fade * now.terms.transition)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
