"""Idioms of systems: the control cycle, one cached evaluation, vector ports that read parts of it, and wiring."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    CacheEntry,
    Context,
    DependencyTicket,
    DiagramBuilder,
    LeafSystem,
    ValueProducer,
)

from saphari_drake.errors import ParameterError

# s; cycles fire this long after their nominal times. Times that are equal on paper differ by rounding, so that without
# it a cycle of 5 ms would sample a plant of 1 ms now before and now after its step.
CYCLE_OFFSET = 1.0e-6


def _drake_version() -> tuple[float, ...]:
    """Return major and minor version; infinity where Drake was not installed by pip."""
    try:
        return tuple(int(number) for number in version("drake").split(".")[:2])
    except PackageNotFoundError:
        return (np.inf,)


# At every step of a simulation pydrake looks in each Python system for a method of this name. That there is none it
# remembers only where it finds one of its own instead: without it the search takes a microsecond a system and step.
# From 1.56 on pydrake would call what it finds, which would call itself.
if _drake_version() < (1, 56) and not hasattr(LeafSystem, "DoGetWitnessFunctions"):
    LeafSystem.DoGetWitnessFunctions = LeafSystem.GetWitnessFunctions


def cycle(period: float) -> dict[str, float]:
    """Return period and offset (s) of a control cycle's events; the first is one period after the start.

    All systems of a cycle declare *unrestricted* updates with it. Drake applies those before discrete updates, so that
    a mix would show one half of the cycle what the other half has decided already.

    Raises
    ------
    ParameterError
        If it is shorter than 10 µs, ten offsets: no arm takes commands so often, and no simulation would end.
    """
    if not period >= 10.0 * CYCLE_OFFSET:
        raise ParameterError("period", f"must be at least {10.0 * CYCLE_OFFSET:g} s, got {period}")
    return {"period_sec": period, "offset_sec": period + CYCLE_OFFSET}


def declare_cache(
    system: LeafSystem,
    description: str,
    initial: object,
    calc: Callable[[Context], object],
    prerequisites: set[DependencyTicket],
) -> CacheEntry:
    """Declare a cache entry that holds what ``calc(context)`` returns; `initial` gives its type."""
    return system.DeclareCacheEntry(
        description=description,
        value_producer=ValueProducer(
            allocate=lambda: AbstractValue.Make(initial),
            calc=lambda context, value: value.set_value(calc(context)),
        ),
        prerequisites_of_calc=prerequisites,
    )


def declare_readouts(
    system: LeafSystem, entry: CacheEntry, readouts: Mapping[str, tuple[int, Callable[[Any], Any]]]
) -> None:
    """Declare a vector output port for each ``name: (size, read)``, with ``read`` applied to the cached value."""
    for name, (size, read) in readouts.items():
        system.DeclareVectorOutputPort(
            name,
            BasicVector(size),
            lambda context, output, read=read: output.SetFromVector(read(entry.Eval(context))),
            prerequisites_of_calc={entry.ticket()},
        )


def connect(builder: DiagramBuilder, *wires: tuple) -> None:
    """Connect ports of equal names, for each wire ``(source, name, *targets)``."""
    for source, name, *targets in wires:
        for target in targets:
            builder.Connect(source.GetOutputPort(name), target.GetInputPort(name))


def declare_outputs(
    system: LeafSystem,
    evaluate: Callable[[Context], Any],
    ticket: DependencyTicket,
    initial: object,
    reads: Mapping[str, Callable[[Any], Any]],
) -> None:
    """Declare an output port for each ``name: read``, with ``read`` applied to what ``evaluate(context)`` returns.

    What `read` makes of `initial` gives the port's type: a vector port for a sequence of numbers, otherwise an abstract
    one. `ticket` is that of the state or cache entry which is evaluated.
    """
    for name, read in reads.items():
        value = read(initial)
        if np.ndim(value) == 1:
            system.DeclareVectorOutputPort(
                name,
                BasicVector(len(value)),
                lambda context, output, read=read: output.SetFromVector(read(evaluate(context))),
                prerequisites_of_calc={ticket},
            )
        else:
            system.DeclareAbstractOutputPort(
                name,
                alloc=lambda value=value: AbstractValue.Make(value),
                calc=lambda context, output, read=read: output.set_value(read(evaluate(context))),
                prerequisites_of_calc={ticket},
            )
