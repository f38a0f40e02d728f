"""Puts a system between an output port and those who read it, in a diagram that is wired already."""

from collections.abc import Iterator

from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import VectorLogSink

from saphari_drake.simulation.record.recorder import ValueToVector


def readers(builder: DiagramBuilder, source: OutputPort) -> list[InputPort]:
    """Return the input ports that a port feeds; recorders, which are to tell the truth, are left out."""
    own = source.get_system(), source.get_index()
    found = [target for target, feeds in builder.connection_map().items() if (feeds[0], feeds[1]) == own]
    recorders = (ValueToVector, VectorLogSink)
    return [system.get_input_port(index) for system, index in found if not isinstance(system, recorders)]


def source_of(builder: DiagramBuilder, target: InputPort) -> OutputPort:
    """Return the port that feeds an input."""
    system, index = builder.connection_map()[target.get_system(), target.get_index()]
    return system.get_output_port(index)


def insert(
    builder: DiagramBuilder,
    source: OutputPort,
    target: InputPort,
    system: LeafSystem,
    ports: tuple[str, str] = ("value", "faulty"),
) -> None:
    """Put a system, added already, on the wire from `source` to `target`; its input may be connected before."""
    builder.Disconnect(source, target)
    entry = system.GetInputPort(ports[0])
    if not builder.IsConnectedOrExported(entry):
        builder.Connect(source, entry)
    builder.Connect(system.GetOutputPort(ports[1]), target)


def of_kind(builder: DiagramBuilder, kind: type) -> Iterator:
    """Return the systems of a class."""
    return (system for system in list(builder.GetSystems()) if isinstance(system, kind))
