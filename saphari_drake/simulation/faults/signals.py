"""Faults of vector signals: a value that is wrong from some time on, and one that stays what it was."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

Array = NDArray[np.float64]
Spoil = Callable[[Array, Array, float], Array]
STEP = 0.001  # s; how often the last good value is remembered


class SignalFault(LeafSystem):
    """Passes a signal on until a fault begins, and then what the fault makes of it.

    .. pydrake_system::

        name: SignalFault
        input_ports:
        - value
        output_ports:
        - faulty
        - acts

    Ports
    -----
    value : `size`, unit and frame of the signal.
    faulty : `size`, the same before `start`, then ``spoil(value, last, since)``: of the value, of the last one before
        the fault, and of the time since its start (s).
    acts : 1, whether an entry that is faulty differs by more than `floor` from what it should be.

    State: the last value before the fault, at steps of 1 ms.
    """

    def __init__(self, size: int, spoil: Spoil, start: float, floor: Array | float = 0.0) -> None:
        super().__init__()
        self._spoil, self._start, self._floor = spoil, start, floor
        self._value = self.DeclareVectorInputPort("value", BasicVector(size))
        self._last = self.DeclareDiscreteState(size)
        tickets = {self._value.ticket(), self.discrete_state_ticket(self._last), self.time_ticket()}
        self.DeclareVectorOutputPort("faulty", BasicVector(size), self._calc, prerequisites_of_calc=tickets)
        self.DeclareVectorOutputPort("acts", BasicVector(1), self._calc_acts, prerequisites_of_calc=tickets)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._remember)
        self.DeclarePeriodicUnrestrictedUpdateEvent(STEP, 0.0, self._remember)

    def _calc(self, context: Context, output: BasicVector) -> None:
        value, since = self._value.Eval(context), context.get_time() - self._start
        if since >= 0.0:
            value = self._spoil(np.array(value), context.get_discrete_state(self._last).value(), since)
        output.SetFromVector(value)

    def _calc_acts(self, context: Context, output: BasicVector) -> None:
        difference = np.abs(self.GetOutputPort("faulty").Eval(context) - self._value.Eval(context))
        output.SetAtIndex(0, float(not np.all(difference <= self._floor)))

    def _remember(self, context: Context, state: State) -> None:
        if context.get_time() < self._start:
            state.get_mutable_discrete_state(self._last).SetFromVector(self._value.Eval(context))


def frozen(rows: Array | slice = slice(None)) -> Spoil:
    """Return a fault in which the entries `rows` stay what they were."""

    def spoil(value: Array, last: Array, since: float) -> Array:
        value[rows] = last[rows]
        return value

    return spoil


def held_for(length: float) -> Spoil:
    """Return a fault in which nothing new comes for some time (s)."""
    return lambda value, last, since: last if since < length else value


def shifted(offset: Array, length: float = np.inf) -> Spoil:
    """Return a fault that adds something for some time (s)."""
    return lambda value, last, since: value + offset if since < length else value


def replaced(rows: Array, by: float) -> Spoil:
    """Return a fault in which the entries `rows` have another value."""

    def spoil(value: Array, last: Array, since: float) -> Array:
        value[rows] = by
        return value

    return spoil


def noisy(sigma: Array, seed: int) -> Spoil:
    """Return a fault that adds noise, new every millisecond."""

    def spoil(value: Array, last: Array, since: float) -> Array:
        rng = np.random.Generator(np.random.SFC64([seed, round(since / STEP)]))
        return value + sigma * rng.standard_normal(len(value))

    return spoil


def encoder(spoil_position: str, joint: int, n: int, glitch: float = 0.0, length: float = np.inf) -> Spoil:
    """Return a fault of one joint's encoder on a state (2n,) or positions (n,): "glitch", "freeze" or "nan"."""

    def spoil(value: Array, last: Array, since: float) -> Array:
        if spoil_position == "glitch":
            value[joint] += glitch if since < length else 0.0
            return value
        value[joint] = last[joint] if spoil_position == "freeze" else np.nan
        if len(value) == 2 * n:
            value[n + joint] = 0.0 if spoil_position == "freeze" else np.nan
        return value

    return spoil
