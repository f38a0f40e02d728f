"""The force controller of a contact that was found."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, State

from saphari_drake.control.contact import law
from saphari_drake.control.contact.gate import ForceGate, ForceStatus
from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.control.contact.system import ContactController, ContactOutput
from saphari_drake.messages import CommandMode, Immutable, SystemStatus, status_of
from saphari_drake.parameters import diagonal
from saphari_drake.robots.kinematics import PointKinematics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle


@dataclass(frozen=True)
class _Memory(Immutable):
    gate: ForceGate
    # Key of the contact whose force was controlled in the cycle before; empty: none, None: no cycle before.
    controlled: tuple[int, ...] | None = None


_MODES = {
    ForceStatus.HOLD: CommandMode.HOLD,
    ForceStatus.CONTROLLED: CommandMode.PASS,
    ForceStatus.PARTIAL: CommandMode.PASS,
    ForceStatus.WEAK: CommandMode.BRAKE,
    ForceStatus.RELEASED: CommandMode.BRAKE,
    ForceStatus.SPEED_STOP: CommandMode.BRAKE,
    ForceStatus.UNSEEN: CommandMode.YIELD,
    ForceStatus.NO_CAMERA: CommandMode.BRAKE,
}


class ContactForceController(ContactController):
    """Keeps the force of a contact at a desired size.

    .. pydrake_system::

        name: ContactForceController
        input_ports:
        - dynamics
        - interaction
        - contact_force
        - misfit
        - friction_torque
        - unobservable_directions
        - transition_left
        output_ports:
        - torque_commanded
        - torque_terms
        - system_status
        - contact_position
        - contact_velocity
        - desired_force
        - force_error
        - force_status
        - stop_velocity
        - selection

    Ports
    -----
    dynamics, interaction, contact_force, misfit, friction_torque : as of `ContactImpedanceController`.
    unobservable_directions : 9, from `ContactForceEstimator`; no force is asked for along them.
    transition_left : n (Nm), from `CommandSwitch`, for the look ahead of the speed stop; optional, default: zero.
    torque_commanded, torque_terms, system_status, contact_position, selection : as of `ContactImpedanceController`.
    contact_velocity : 3 (m/s, world), of the contact point; zero without one.
    desired_force : 3 (N, world), F_d, its observable part; zero while no force is controlled.
    force_error : 3 (N, world), F̂ − F_d; zero while no force is controlled.
    force_status : 1, a `ForceStatus`; says whether the force is controlled, in which directions, or why not.
    stop_velocity : 3 (m/s, world), the velocity for which the speed stop acted; zero without a stop.

    In contact, with ‖F̂‖ above the gate: `contact_force_torque`, with an aligned F_d by `pressing_direction`. Below it,
    and after the release: braking to rest. Without a camera the same; yielding if the contact is not seen. Nothing
    returns to where it was touched: give the monitor a short `return_timeout`, after which the arm holds where it came
    to rest.

    Speed stop: ‖ẋ_c‖ or ‖ẋ_c + stop_lead ẍ_c‖ near the limit ends the force control in favour of braking, until the
    contact is released. It has to look ahead: 15 N that nobody resists move a light contact at 10 m/s² and more. In
    its first cycle the torque is still that of the law before: the velocity alone counts. The same stop ends it when
    the contact has gone `follow_limit` after a hand that leaves.
    """

    def __init__(self, robot: RobotModel, params: ContactForceControlParameters | None = None) -> None:
        params = params or ContactForceControlParameters()
        readouts = {
            "contact_velocity": (3, lambda o: o.v_WC),
            "desired_force": (3, lambda o: o.F_d),
            "force_error": (3, lambda o: o.error),
            "force_status": (1, lambda o: [float(o.status)]),
            "stop_velocity": (3, lambda o: o.gate.stop_velocity),
        }
        super().__init__(robot, params, readouts)
        K_f, K_d = (np.diag(diagonal(getattr(params, name), 3, name)) for name in ("K_f", "K_d"))
        masses = params.misfit_lever, params.max_effective_mass, params.least_effective_mass
        self.gains = law.ForceGains(K_f, K_d, self._M_d_inv, self._K_N, *masses)
        self._params, self._fixed = params, np.array(params.fixed_force, dtype=float)
        self._unobservable = self.DeclareVectorInputPort("unobservable_directions", BasicVector(9))
        self._left = self.DeclareVectorInputPort("transition_left", BasicVector(robot.n))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory(ForceGate())))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)

    def _answer(self, context: Context, point: PointKinematics | None, idle: ContactOutput) -> ContactOutput:
        params, mode = self._params, self._interaction.Eval(context).mode
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        terms, F, misfit = (port.Eval(context) for port in (self._dynamics, self._force, self._misfit))
        known = status_of(F) == SystemStatus.OK
        gate = memory.gate.after(mode, float(np.linalg.norm(F)) if known else np.nan, params)
        if point is not None and gate.open:
            hidden = self._unobservable.Eval(context).reshape(3, 3).T
            if status_of(misfit, hidden) != SystemStatus.OK:
                return self._unknown(idle)
            wanted = self._fixed
            if params.direction == "aligned":
                contact = self._interaction.Eval(context).contact
                inward = -terms.R_WL[contact.link] @ contact.n_L
                wanted = gate.size * law.pressing_direction(F, inward, params.leaning)
            F_d = law.observable_part(wanted, hidden)
            parts, acceleration = law.contact_force_torque(terms, point, F, F_d, misfit, self.gains)
            goes_on = memory.controlled in (None, idle.selection.key)
            if goes_on and self._left.HasValue(context):
                acceleration = acceleration + point.Jv_WC @ np.linalg.solve(terms.M, self._left.Eval(context))
            gate = gate.following(point.v_WC, F_d, params)
            gate = gate.checked(point.v_WC, acceleration if goes_on else np.zeros(3), params)
            status = ForceStatus.PARTIAL if np.any(hidden) else ForceStatus.CONTROLLED
            parts = self._rubbing(context, parts)
            output = idle._replace(terms=parts, error=F - F_d, F_d=F_d, status=status, gate=gate)
        if not gate.open:
            status = gate.status(mode)
            # Released, the arm rests where it is, and does not go back to where it was stopped.
            key = (*idle.selection.key, int(status == ForceStatus.RELEASED))
            selection = replace(idle.selection, mode=_MODES[status], key=key)
            output = idle._replace(status=status, gate=gate, selection=selection)
        return output

    def _update(self, context: Context, state: State) -> None:
        now: ContactOutput = self._output.Eval(context)
        if status_of(*now.terms) == SystemStatus.OK:
            passed = now.selection.mode == CommandMode.PASS
            memory = _Memory(now.gate, now.selection.key if passed else ())
            state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
