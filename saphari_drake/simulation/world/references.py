"""What is wanted over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.systems import CYCLE_OFFSET, cycle


class Reference(LeafSystem):
    """Functions of time.

    .. pydrake_system::

        name: Reference
        output_ports:
        - (each name of `functions`)

    Ports
    -----
    (each name) : what its function returns: a vector for an array of one dimension or a number, otherwise abstract.

    Parameters
    ----------
    functions : mapping from str to callable
        Each takes the time (s). Unit and frame are those of what it returns, whose kind and size do not change.
    period : float, optional
        Each value is sampled at the start of a cycle of this length (s) and held; default: values follow the time.

    State: the values of the cycle.
    """

    def __init__(self, functions: Mapping[str, Callable[[float], Any]], period: float | None = None) -> None:
        super().__init__()
        self._functions = dict(functions)
        first = self._sample(0.0)
        self._is_held, ticket = period is not None, self.time_ticket()
        if period is not None:
            self._held = self.DeclareAbstractState(AbstractValue.Make(first))
            ticket = self.abstract_state_ticket(self._held)
            self.DeclareInitializationUnrestrictedUpdateEvent(self._update)
            self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)
        for name, value in first.items():
            if isinstance(value, np.ndarray):

                def write(context: Context, output: BasicVector, name: str = name) -> None:
                    output.SetFromVector(np.ravel(self._value(context, name)))

                self.DeclareVectorOutputPort(name, BasicVector(value.size), write, {ticket})
                continue

            def put(context: Context, output: AbstractValue, name: str = name) -> None:
                output.set_value(self._value(context, name))

            self.DeclareAbstractOutputPort(name, lambda value=value: AbstractValue.Make(value), put, {ticket})

    def _sample(self, time: float) -> dict[str, Any]:
        values = {name: function(time) for name, function in self._functions.items()}
        plain = (np.ndarray, list, tuple, float, int)
        return {name: np.ravel(value) if isinstance(value, plain) else value for name, value in values.items()}

    def _value(self, context: Context, name: str) -> Any:
        if not self._is_held:
            return self._functions[name](context.get_time())
        return context.get_abstract_state(int(self._held)).get_value()[name]

    def _update(self, context: Context, state: State) -> None:
        values = self._sample(max(context.get_time() - CYCLE_OFFSET, 0.0))
        state.get_mutable_abstract_state(int(self._held)).set_value(values)
