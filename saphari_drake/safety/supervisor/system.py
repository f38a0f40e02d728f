"""The supervisor as a system, and the choice of the torque that follows from it."""

from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import CommandMode, Immutable, Selection
from saphari_drake.safety.supervisor.law import CellState, Observed, Situation, speed_limit, supervised
from saphari_drake.safety.supervisor.parameters import SupervisorParameters
from saphari_drake.systems import cycle, declare_cache, declare_outputs, declare_readouts

JOB, CONTACT, GUIDING = range(3)  # the sources of the torque
_SOURCE = {CellState.CONTACT: CONTACT, CellState.GUIDING: GUIDING}


class _Memory(Immutable):
    def __init__(self, situation: Situation, limit: float = 0.0) -> None:
        self.situation, self.limit = situation, limit


class Supervisor(LeafSystem):
    """Decides what a robot beside people does, by one table of transitions.

    .. pydrake_system::

        name: Supervisor
        input_ports:
        - speed_scale
        - touched
        - taken
        - faults
        - recover
        - contact_selection
        output_ports:
        - selection
        - speed_limit
        - state
        - reason
        - time_in_state
        - source
        - fault

    Ports
    -----
    speed_scale : 1, share of the commanded speed that people leave, from 0 to 1.
    touched : 1, not 0 while the robot is touched; optional: never.
    taken : 1, not 0 while a person holds skin or tool; optional: never.
    faults : one status for each of `fault_names`, 0: none; optional: none. Not finite: a fault.
    recover : 1, not 0 to leave a fault; optional: never.
    contact_selection : abstract `Selection`, of the contact controller; optional: its torque is passed on.
    selection : abstract `Selection`, for `CommandSwitch`, whose torque is that of `source`.
    speed_limit : 1, share of the job's speed that is allowed in this cycle: never more than `speed_scale` at its begin.
    state, reason : 1, a `CellState`, and the `Event` that led to it.
    time_in_state : 1 (s).
    source : 1, whose torque is taken: 0 the job, 1 the contact controller, 2 the guiding.
    fault : 1, index of the status that told the fault, −1 without.

    Law: `supervised` with the table `TRANSITIONS`. It selects and reduces, and never adds. It starts in STOP. An input
    that is not finite is a fault; from it only `recover` leads back, to STOP.
    """

    def __init__(self, params: SupervisorParameters | None = None) -> None:
        super().__init__()
        self._params = params or SupervisorParameters()
        count = len(self._params.fault_names)
        self._scale = self.DeclareVectorInputPort("speed_scale", BasicVector(1))
        self._flags = [self.DeclareVectorInputPort(name, BasicVector(1)) for name in ("touched", "taken")]
        self._faults = self.DeclareVectorInputPort("faults", BasicVector(count))
        self._recover = self.DeclareVectorInputPort("recover", BasicVector(1))
        self._contact = self.DeclareAbstractInputPort("contact_selection", AbstractValue.Make(Selection()))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory(Situation())))
        ticket = self.abstract_state_ticket(self._memory)
        selected = declare_cache(self, "selection", Selection(), self._selected, {ticket, self._contact.ticket()})
        declare_outputs(self, selected.Eval, selected.ticket(), Selection(), {"selection": lambda value: value})
        memory = declare_cache(self, "memory", _Memory(Situation()), self._remembered, {ticket})
        readouts = {
            "speed_limit": (1, lambda m: [m.limit]),
            "state": (1, lambda m: [float(m.situation.state)]),
            "reason": (1, lambda m: [float(m.situation.reason)]),
            "time_in_state": (1, lambda m: [m.situation.since]),
            "source": (1, lambda m: [float(_SOURCE.get(m.situation.state, JOB))]),
            "fault": (1, lambda m: [float(m.situation.fault)]),
        }
        declare_readouts(self, memory, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _selected(self, context: Context) -> Selection:
        situation = self._remembered(context).situation
        if situation.state == CellState.FAULT:
            return Selection(CommandMode.BRAKE, key=(situation.state,))
        if situation.state == CellState.CONTACT:
            if self._params.answer == "stop":
                return Selection(CommandMode.BRAKE, key=(situation.state,))
            if self._contact.HasValue(context):
                chosen: Selection = self._contact.Eval(context)
                return replace(chosen, key=(situation.state, *chosen.key))
        return Selection(CommandMode.PASS, key=(_SOURCE.get(situation.state, JOB),))

    def _observed(self, context: Context) -> Observed:
        scale = float(self._scale.Eval(context)[0])
        flags = [port.Eval(context)[0] if port.HasValue(context) else 0.0 for port in (*self._flags, self._recover)]
        faults = np.array(self._faults.Eval(context)) if self._faults.HasValue(context) else np.zeros(0)
        broken = np.flatnonzero(faults != 0.0)  # not a number differs from zero too
        fault = int(broken[0]) if broken.size else -1
        if fault < 0 and not np.isfinite([scale, *flags]).all():
            fault = len(faults)
        touched, taken, recover = (bool(flag) for flag in flags)
        return Observed(scale, touched, taken, fault, recover)

    def _update(self, context: Context, state: State) -> None:
        seen = self._observed(context)
        after = supervised(self._remembered(context).situation, seen, self._params)
        limit = speed_limit(after.state, seen.speed_scale if np.isfinite(seen.speed_scale) else 0.0)
        state.get_mutable_abstract_state(int(self._memory)).set_value(_Memory(after, limit))


class TorqueChoice(LeafSystem):
    """Passes on the torque of the source that a supervisor names.

    .. pydrake_system::

        name: TorqueChoice
        input_ports:
        - source
        - torque_job
        - torque_contact
        - torque_guiding
        output_ports:
        - torque_commanded

    Ports
    -----
    source : 1, as `Supervisor` gives it; another number, or one without a port: NaN, which `CommandSwitch` answers.
    torque_job, torque_contact, torque_guiding : n (Nm or N); the last two are optional.
    torque_commanded : n (Nm or N).
    """

    def __init__(self, n: int) -> None:
        super().__init__()
        self._n, self._source = n, self.DeclareVectorInputPort("source", BasicVector(1))
        names = ("torque_job", "torque_contact", "torque_guiding")
        self._torques = [self.DeclareVectorInputPort(name, BasicVector(n)) for name in names]
        tickets = {port.ticket() for port in (self._source, *self._torques)}
        self.DeclareVectorOutputPort("torque_commanded", BasicVector(n), self._calc, tickets)

    def _calc(self, context: Context, output: BasicVector) -> None:
        source, torque = self._source.Eval(context)[0], np.full(self._n, np.nan)
        if source in range(len(self._torques)) and self._torques[int(source)].HasValue(context):
            torque = np.array(self._torques[int(source)].Eval(context))
        output.SetFromVector(torque)
