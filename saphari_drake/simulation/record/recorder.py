"""Recorder: logs output ports of a diagram, vectors or abstract values, on one time axis."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
    PortDataType,
)
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.record.log import RESERVED, Log

_SINK = re.compile(r"log (.*) every (\S+) s")


class ValueToVector(LeafSystem):
    """Turns the value of an abstract port into a vector by a function.

    .. pydrake_system::

        name: ValueToVector
        input_ports:
        - value
        output_ports:
        - vector

    Ports
    -----
    value : any abstract value.
    vector : `size`, ``extract(value)``; unit and frame are those of the function.
    """

    def __init__(self, port: OutputPort, extract: Callable[[Any], ArrayLike], size: int) -> None:
        super().__init__()
        self._extract, self._size = extract, size
        self._value = self.DeclareAbstractInputPort("value", port.Allocate())
        self.DeclareVectorOutputPort("vector", size, self._calc, {self._value.ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        vector = np.asarray(self._extract(self._value.Eval(context)), dtype=float).reshape(-1)
        if vector.size != self._size:
            raise ParameterError(self.get_name(), f"extract gave {vector.size} numbers, {self._size} are declared")
        output.SetFromVector(vector)


class Recorder:
    """Logs ports every `period`; call `add` before the diagram is built and `log` after the run.

    The samples live in the Context (Drake's VectorLogSink), so each Context has its own. A sample at time t is
    taken before the periodic updates of that time are made. The last sample is at the last multiple of the period
    that was reached.

    Parameters
    ----------
    builder : DiagramBuilder
    period : float
        Sample period (s).
    """

    def __init__(self, builder: DiagramBuilder, period: float) -> None:
        if not (np.isfinite(period) and period > 0.0):
            raise ParameterError("period", f"must be positive and finite, got {period}")
        self._builder, self._period = builder, period
        self._sinks: dict[str, tuple[VectorLogSink, str, Callable[[Any], ArrayLike] | None]] = {}

    def add(
        self,
        name: str,
        port: OutputPort,
        unit: str = "",
        extract: Callable[[Any], ArrayLike] | None = None,
        size: int | None = None,
    ) -> None:
        """Log a port under a name.

        Parameters
        ----------
        name : str
            Name of the signal in the log.
        port : OutputPort
            Port of a system in the builder.
        unit : str
            Unit of the signal.
        extract : callable, optional
            Turns the port's value into a vector; needed for an abstract port. Applied to a vector port after the run.
        size : int, optional
            Size of the vector of an abstract port; default: that of ``extract`` applied to the port's default value.
        """
        if name in self._sinks or name in RESERVED:
            raise ParameterError(name, "a signal of this name exists")
        if port.get_data_type() != PortDataType.kVectorValued:
            if extract is None:
                raise ParameterError(name, "an abstract port needs extract, a function from its value to a vector")
            size = np.size(extract(port.Allocate().get_value())) if size is None else size
            converter = self._builder.AddSystem(ValueToVector(port, extract, size))
            converter.set_name(f"record {name} every {self._period:g} s")
            self._builder.Connect(port, converter.get_input_port())
            port, extract = converter.get_output_port(), None
        sink = LogVectorOutput(port, self._builder, self._period)
        sink.set_name(f"log {name} every {self._period:g} s")
        self._sinks[name] = (sink, unit, extract)

    def log(self, diagram: Diagram, root_context: Context) -> Log:
        """Return all signals recorded in the diagram's root context.

        Raises
        ------
        ParameterError
            If nothing was added.
        """
        if not self._sinks:
            raise ParameterError("recorder", "no port was added")
        return _log({name: (sink.FindLog(root_context), *rest) for name, (sink, *rest) in self._sinks.items()})


def recorded(diagram: Diagram, root_context: Context) -> Log:
    """Return, of all that the recorders of a diagram hold, the largest part with one time axis, without units."""
    groups: dict[str, dict[str, Any]] = {}
    for system in diagram.GetSystems():
        found = _SINK.fullmatch(system.get_name()) if isinstance(system, VectorLogSink) else None
        if found:
            groups.setdefault(found[2], {})[found[1]] = system.FindLog(root_context), "", None
    return _log(max(groups.values(), key=len)) if groups else Log([])


def _log(parts: dict[str, Any]) -> Log:
    """What sinks hold, by name: each with its unit, and what turns its rows into values."""
    # A forced publish logs at its own time; of samples with the same time the last one counts.
    time, *others = [item.sample_times() for item, *_ in parts.values()]
    if not all(np.array_equal(time, other) for other in others):
        raise ParameterError("recorder", "the signals were logged at different times")
    keep = np.append(np.diff(time) > 0.0, True) if time.size else np.zeros(0, dtype=bool)
    result = Log(time[keep])
    for name, (item, unit, extract) in parts.items():
        rows = item.data().T[keep]
        values = rows if extract is None else np.reshape([extract(row) for row in rows], (len(rows), -1))
        result.add(name, values, unit)
    return result
