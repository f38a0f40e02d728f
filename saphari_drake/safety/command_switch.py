"""Passes on, holds, brakes or yields, and hands over between them without a jump."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import CommandMode, Immutable, Selection, SystemStatus
from saphari_drake.parameters import diagonal, require_positive
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.posture_laws import Coasting, Yield, posture_torque, yield_torque
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class CommandSwitchParameters:
    """Behaviour without the command of a controller, and how one law hands over to the next."""

    # 1/s², stiffness over inertia of the held posture; one value or one a joint. Assumed.
    hold_stiffness: list[float] | float = 225.0
    # 1/s, damping over inertia of the held posture, and while braking. Assumed.
    hold_damping: list[float] | float = 30.0
    # 1/s² and 1/s, the same while yielding,
    yield_stiffness: list[float] | float = 25.0
    yield_damping: list[float] | float = 10.0
    # up to this way of a joint from where it was felt (rad or m); beyond, it resists as the held posture does. Assumed.
    yield_travel: list[float] | float = 0.15
    # rad/s or m/s, and s; braking holds the posture where all joints are this slow, or after this time. Assumed.
    rest_speed: float = 0.02
    rest_time: float = 0.3
    # s, time constant with which the torque of the law that was left fades; the second holds while braking, and while
    # holding because of a fault. Assumed.
    transition_time: float = 0.1
    brake_time: float = 0.01
    # s; how long state and command must be good again before a fault ends. Assumed.
    recovery_time: float = 0.1
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        for name in ("hold_stiffness", "hold_damping", "yield_stiffness", "yield_damping"):
            value = getattr(self, name)
            diagonal(value, np.size(value), name)
        times = ("rest_time", "transition_time", "brake_time", "recovery_time", "period")
        require_positive(self, "yield_travel", "rest_speed", *times)


@dataclass(frozen=True)
class Handover(Immutable):
    """Law, applied torque and fading offset of the cycle before, for a change of law without a jump."""

    law: tuple | None
    torque: Array
    offset: Array

    def into(self, law: tuple, torque: Array) -> Array:
        """Return the offset (n,) that makes `torque` of `law` continue the torque of the cycle before."""
        return self.offset if self.law in (None, law) else self.torque - torque


@dataclass(frozen=True)
class _Memory(Immutable):
    handover: Handover
    coasting: Coasting  # from the last known state
    q_rest: Array | None = None  # held since braking has ended
    braking: float = 0.0  # s
    q_fault: Array | None = None  # held since the state was known in a fault
    recovering: float = 0.0  # s; left of a fault


class _Choice(NamedTuple):
    torque: Array
    law: tuple
    status: SystemStatus
    coasting: Coasting
    q_fault: Array | None = None
    faulty: bool = False  # now, not a moment ago


class _Output(NamedTuple):
    choice: _Choice
    transition: Array
    torque: Array


class CommandSwitch(LeafSystem):
    """Decides what reaches the torque limit: the command of a controller, or a posture held, braked or yielding.

    .. pydrake_system::

        name: CommandSwitch
        input_ports:
        - dynamics
        - selection
        - torque_applied
        - torque_commanded
        output_ports:
        - torque_commanded
        - transition
        - system_status
        - transition_left

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    selection : abstract `Selection`, from a controller or whoever supervises it; optional, default: pass always.
    torque_applied : n (Nm or N), of the torque limit behind, from which the next law goes on; optional, default: the
        command. No output depends on it.
    torque_commanded (input) : n (Nm or N), of the controller; not read while another mode is selected.
    torque_commanded (output) : n (Nm or N), always finite.
    transition : n (Nm or N), the part of it that continues the law before, and fades.
    transition_left : n (Nm or N), what the last hand-over left for this cycle, unless the law has just changed; does
        not depend on any input, so that a controller can be told.
    system_status : 1, a `SystemStatus`: OK, HOLDING or BRAKES_ON.

    Modes, by `posture_torque` and `yield_torque`: HOLD keeps the latched posture; BRAKE takes the speed out and then
    keeps the posture where it came to rest; YIELD gives way about the latched posture, up to a travel.
    Fault: a command or latched posture that is not finite or has a wrong size. The posture is held where it began, as
    long as it lasts and `recovery_time` more. A state that is not known asks for the brakes: nothing can be fed back.
    The last known gravity torque is kept, as the brakes may be late, and the last known momentum is taken out as
    braking would, foreseen without feedback (`Coasting`); what others push meanwhile is not seen. The posture is held
    from where the state is known again. At the start the weight at home is the last known gravity torque.
    """

    def __init__(self, robot: RobotModel, params: CommandSwitchParameters | None = None) -> None:
        super().__init__()
        self._params = p = params or CommandSwitchParameters()
        n = robot.n
        names = ("yield_stiffness", "yield_damping", "yield_travel", "hold_stiffness", "hold_damping")
        self._yield = Yield(*(diagonal(getattr(p, name), n, name) for name in names))
        self._stiffness, self._damping = self._yield.hold_stiffness, self._yield.hold_damping
        self._fade, self._brake_fade = np.exp(-p.period / p.transition_time), np.exp(-p.period / p.brake_time)
        terms, zero = evaluate_dynamics(robot, robot.home, np.zeros(n)), np.zeros(n)
        self._dynamics = DynamicsInput(self, terms)
        self._selection = self.DeclareAbstractInputPort("selection", AbstractValue.Make(Selection()))
        self._applied = self.DeclareVectorInputPort("torque_applied", BasicVector(n))
        self._command = self.DeclareVectorInputPort("torque_commanded", BasicVector(n))
        rest = Coasting(terms.M, terms.g, zero)
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory(Handover(None, terms.g, zero), rest)))
        start = _Output(_Choice(terms.g, (), SystemStatus.OK, rest), zero, terms.g)
        state = self.abstract_state_ticket(self._memory)
        tickets = {self._dynamics.ticket(), self._selection.ticket(), self._command.ticket(), state}
        self._output = declare_cache(self, "command", start, self._evaluate, tickets)
        readouts = {
            "torque_commanded": (n, lambda o: o.torque),
            "transition": (n, lambda o: o.transition),
            "system_status": (1, lambda o: [float(o.choice.status)]),
        }
        declare_readouts(self, self._output, readouts)
        left = declare_cache(self, "left", zero, lambda context: self._remembered(context).handover.offset, {state})
        declare_readouts(self, left, {"transition_left": (n, lambda offset: offset)})
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(p.period), update=self._update)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _evaluate(self, context: Context) -> _Output:
        choice = self._choose(context, self._remembered(context))
        transition = self._remembered(context).handover.into(choice.law, choice.torque)
        return _Output(choice, transition, choice.torque + transition)

    def _choose(self, context: Context, memory: _Memory) -> _Choice:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        if not terms.finite:
            lost, p = memory.coasting, self._params
            after = lost.after(self._damping, p.period)
            return _Choice(lost.torque(self._damping), ("brakes",), SystemStatus.BRAKES_ON, after, faulty=True)
        known = Coasting(terms.M, terms.g, terms.v)
        selection = self._selection.Eval(context) if self._selection.HasValue(context) else Selection()
        torque = self._selected(context, memory, terms, selection)
        faulty = torque.shape != terms.q.shape or not np.isfinite(torque).all()
        if not faulty and memory.recovering == 0.0:
            return _Choice(torque, (selection.mode, *selection.key), SystemStatus.OK, known)
        q_fault = terms.q if memory.q_fault is None else memory.q_fault
        torque = posture_torque(terms, q_fault, self._stiffness, self._damping)
        return _Choice(torque, ("fault",), SystemStatus.HOLDING, known, q_fault, faulty)

    def _selected(self, context: Context, memory: _Memory, terms: DynamicsTerms, selection: Selection) -> Array:
        """Return the torque of the selected mode; not finite, or of another size, if that is not possible."""
        if selection.mode == CommandMode.PASS:
            return np.array(self._command.Eval(context))
        if selection.mode == CommandMode.BRAKE:
            goes_on = memory.handover.law == (selection.mode, *selection.key)
            q_rest = memory.q_rest if goes_on and memory.q_rest is not None else terms.q
            return posture_torque(terms, q_rest, self._stiffness, self._damping)
        if selection.q_latched.shape != terms.q.shape:
            return np.zeros(0)
        if selection.mode == CommandMode.YIELD:
            return yield_torque(terms, selection.q_latched, self._yield)
        return posture_torque(terms, selection.q_latched, self._stiffness, self._damping)

    def _update(self, context: Context, state: State) -> None:
        p, before, now = self._params, self._remembered(context), self._output.Eval(context)
        choice = now.choice
        applied = self._applied.Eval(context) if self._applied.HasValue(context) else now.torque
        applied = np.array(applied if np.isfinite(applied).all() else now.torque)
        braking = choice.status != SystemStatus.OK or choice.law[0] == CommandMode.BRAKE
        handover = Handover(choice.law, applied, (self._brake_fade if braking else self._fade) * now.transition)
        recovering = p.recovery_time if choice.faulty else max(0.0, before.recovering - p.period)
        goes_on = choice.law == before.handover.law and choice.law[0] == CommandMode.BRAKE
        q_rest, time = (before.q_rest, before.braking + p.period) if goes_on else (None, p.period)
        terms: DynamicsTerms = self._dynamics.Eval(context)
        if terms.finite and q_rest is None and (np.max(np.abs(terms.v)) < p.rest_speed or time >= p.rest_time):
            q_rest = terms.q
        memory = _Memory(handover, choice.coasting, q_rest, time, choice.q_fault, recovering)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
