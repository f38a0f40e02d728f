"""The impedance controller of a contact that was found, and what it shares with the force controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.control.contact import law
from saphari_drake.control.contact.gate import ForceGate, ForceStatus
from saphari_drake.control.contact.parameters import ContactForceControlParameters, ContactImpedanceParameters
from saphari_drake.math.task_space import consistent_inverse
from saphari_drake.messages import (
    CommandMode,
    ContactPoint,
    Interaction,
    InteractionMode,
    Selection,
    SystemStatus,
    status_of,
)
from saphari_drake.parameters import diagonal, positive_definite
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.kinematics import PointKinematics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import declare_cache, declare_outputs, declare_readouts

Array = NDArray[np.float64]
_MODES = {
    InteractionMode.HOLD: CommandMode.HOLD,
    InteractionMode.YIELD: CommandMode.YIELD,
    InteractionMode.STOP: CommandMode.BRAKE,
}
ANSWERED = (InteractionMode.CONTACT, InteractionMode.RETURN)


class ContactOutput(NamedTuple):
    """What a cycle gives out."""

    terms: law.TorqueTerms
    selection: Selection
    p_WC: Array
    v_WC: Array
    error: Array  # of the position or of the force
    F_d: Array
    status: ForceStatus = ForceStatus.HOLD
    gate: ForceGate = ForceGate()


class ContactController(LeafSystem):
    """What both controllers share: inputs, outputs, and what is known of the contact."""

    def __init__(
        self,
        robot: RobotModel,
        params: ContactImpedanceParameters | ContactForceControlParameters,
        readouts: Mapping[str, tuple[int, Callable[[Any], Any]]],
    ) -> None:
        super().__init__()
        consistent_inverse(np.eye(3, robot.n), np.eye(robot.n), 1.0)  # compiled before the first control step
        self._robot, n = robot, robot.n
        shaped = len(params.M_d) > 0
        self._M_d_inv = np.array(np.linalg.inv(positive_definite(params.M_d, 3, "M_d"))) if shaped else None
        self._K_N = diagonal(params.K_N, n, "K_N")
        terms, none = evaluate_dynamics(robot, robot.home, np.zeros(n)), np.zeros(3)
        nobody = Interaction(InteractionMode.HOLD, ContactPoint(), robot.home, 0)
        self._dynamics = DynamicsInput(self, terms)
        self._interaction = self.DeclareAbstractInputPort("interaction", AbstractValue.Make(nobody))
        self._force = self.DeclareVectorInputPort("contact_force", BasicVector(3))
        self._misfit = self.DeclareVectorInputPort("misfit", BasicVector(n))
        self._friction, self._compensated = (
            self.DeclareVectorInputPort("friction_torque", BasicVector(n)),
            params.friction_share,
        )
        start = ContactOutput(_weight(terms), Selection(), none, none, none, none)
        tickets = {self.all_input_ports_ticket(), self.all_state_ticket()}
        self._output = declare_cache(self, "torque", start, self._evaluate, tickets)
        shared = {
            "torque_commanded": (n, lambda o: o.terms.total()),
            "torque_terms": (len(law.TorqueTerms._fields) * n, lambda o: np.concatenate(o.terms)),
            "system_status": (1, lambda o: [status_of(*o.terms)]),
            "contact_position": (3, lambda o: o.p_WC),
        }
        declare_readouts(self, self._output, {**shared, **readouts})
        selection = {"selection": lambda output: output.selection}
        declare_outputs(self, self._output.Eval, self._output.ticket(), start, selection)

    def _evaluate(self, context: Context) -> ContactOutput:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        now: Interaction = self._interaction.Eval(context)
        link, p_LC, answered, none = now.contact.link, now.contact.p_LC, now.mode in ANSWERED, np.zeros(3)
        selection = Selection(CommandMode.PASS, now.q_latched, (now.onset, link))
        idle = ContactOutput(_weight(terms), selection, none, none, none, none)
        sized = np.shape(now.q_latched) == terms.q.shape and (now.contact.usable(len(terms.q)) or not answered)
        if not (terms.finite and sized and status_of(now.q_latched) == SystemStatus.OK):
            return self._unknown(idle)
        point = terms.point(link, p_LC) if answered else None
        if point is not None:
            idle = idle._replace(p_WC=point.p_WC, v_WC=point.v_WC)
        return self._answer(context, point, idle)

    def _rubbing(self, context: Context, terms: law.TorqueTerms) -> law.TorqueTerms:
        """Return the terms with friction compensated."""
        if not self._friction.HasValue(context):
            return terms
        return terms._replace(friction=-self._compensated * self._friction.Eval(context))

    def _unknown(self, idle: ContactOutput) -> ContactOutput:
        """Return the output while an input is not finite."""
        return idle._replace(terms=law.TorqueTerms(*np.full((len(idle.terms), self._robot.n), np.nan)))

    def _answer(self, context: Context, point: PointKinematics | None, idle: ContactOutput) -> ContactOutput:
        """Return the output for a known state; `point` is None without a contact, `idle` has no torque but weight."""
        raise NotImplementedError


def _weight(terms: DynamicsTerms) -> law.TorqueTerms:
    zero = 0.0 * terms.g
    return law.TorqueTerms(zero, zero, zero, zero, terms.Cv, terms.g, zero)


class ContactImpedanceController(ContactController):
    """Answers a contact with an impedance.

    .. pydrake_system::

        name: ContactImpedanceController
        input_ports:
        - dynamics
        - interaction
        - contact_force
        - misfit
        - friction_torque
        output_ports:
        - torque_commanded
        - torque_terms
        - system_status
        - contact_position
        - position_error
        - selection

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    interaction : abstract `Interaction`, from `ContactMonitor`.
    contact_force : 3 (N, world), from `ContactForceEstimator`; with the natural inertia, bounds the misfit only.
    misfit : n (Nm), from `ContactForceEstimator`.
    friction_torque : n (Nm), from `MomentumObserver`, compensated during contact and return; optional, default: zero.
    torque_commanded : n (Nm), without limits; NaN while an input that it needs is not finite.
    torque_terms : 7n (Nm), the parts of `TorqueTerms` one after the other; their sum is the command.
    system_status : 1, a `SystemStatus`.
    contact_position : 3 (m, world), the controlled contact point; zero without one.
    position_error : 3 (m, world), x_d − x_c during contact and return, else zero.
    selection : abstract `Selection`, for `CommandSwitch`.

    In contact and return: `contact_impedance_torque`, with x_d where the contact point was when the contact began.
    Else Coriolis and gravity terms, in favour of a posture held, yielding, or a stop.
    """

    def __init__(self, robot: RobotModel, params: ContactImpedanceParameters | None = None) -> None:
        params = params or ContactImpedanceParameters()
        super().__init__(robot, params, {"position_error": (3, lambda o: o.error)})
        K_p, K_d = (np.diag(diagonal(getattr(params, name), 3, name)) for name in ("K_p", "K_d"))
        heaviest = params.max_natural_mass if self._M_d_inv is None else params.max_effective_mass
        masses = params.misfit_lever, heaviest, params.least_effective_mass, params.least_damping
        bound = np.broadcast_to(params.return_torque, robot.n)
        self.gains = law.ImpedanceGains(K_p, K_d, self._M_d_inv, self._K_N, *masses, bound)

    def _answer(self, context: Context, point: PointKinematics | None, idle: ContactOutput) -> ContactOutput:
        now: Interaction = self._interaction.Eval(context)
        if point is None:
            return idle._replace(selection=replace(idle.selection, mode=_MODES[now.mode]))
        terms, F, misfit = (port.Eval(context) for port in (self._dynamics, self._force, self._misfit))
        if status_of(F, misfit) != SystemStatus.OK:
            return self._unknown(idle)
        p_desired = self._robot.kinematics(now.q_latched).position(now.contact.link, now.contact.p_LC)
        q_return = None if now.mode == InteractionMode.CONTACT else now.q_latched
        parts = law.contact_impedance_torque(terms, point, p_desired, F, misfit, self.gains, q_return)
        return idle._replace(terms=self._rubbing(context, parts), error=p_desired - point.p_WC)
