"""What is wanted over time: signals that are functions of time, and paths that rest at points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.common.value import AbstractValue
from pydrake.polynomial import Polynomial
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State
from pydrake.trajectories import PiecewisePolynomial

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
                    output.SetFromVector(self._value(context, name))

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


def rest_to_rest(times: ArrayLike, points: ArrayLike) -> PiecewisePolynomial:
    """Return a path that is at rest at each of its points, in between a quintic (minimum jerk; Flash and Hogan 1985).

    Parameters
    ----------
    times : (k,) array
        When it is at each point (s), not decreasing; of points at the same time the first counts.
    points : (k, m) array
    """
    at = np.asarray(times, dtype=float)
    kept = np.diff(at, prepend=-np.inf) > 0.0
    at, rows, pieces = at[kept], np.asarray(points, dtype=float).reshape(len(at), -1)[kept], []
    for start, end, T in zip(rows, rows[1:], np.diff(at)):
        shape = np.array([0.0, 0.0, 0.0, 10.0 / T**3, -15.0 / T**4, 6.0 / T**5])
        at_start = np.outer(start, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        pieces.append(np.array([[Polynomial(c)] for c in at_start + np.outer(end - start, shape)]))
    return PiecewisePolynomial(pieces, at)
