"""Two idioms of a LeafSystem: one cached evaluation, and vector ports that read parts of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, CacheEntry, Context, DependencyTicket, LeafSystem, ValueProducer


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
