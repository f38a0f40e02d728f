"""The exceptions of this library: one base, and members that carry what went wrong."""

from __future__ import annotations

from collections.abc import Iterable


class SaphariError(Exception):
    """Base of every error that this library raises on purpose."""


class ModelError(SaphariError):
    """A robot model cannot be used: it does not parse, or lacks something that is needed."""


class ParameterError(SaphariError, ValueError):
    """A parameter has a value that cannot be used.

    Attributes
    ----------
    field : str
        Dotted name of the parameter.
    """

    def __init__(self, field: str, message: str) -> None:
        self.field = field
        super().__init__(f"{field}: {message}")


class UnknownNameError(SaphariError, KeyError):
    """A name that the model or scenario does not have; the message lists those that exist.

    Attributes
    ----------
    kind, name : str
        What was looked for ("frame", "link", "joint", …) and its name.
    available : tuple of str
        The names that exist.
    """

    def __init__(self, kind: str, name: object, available: Iterable[object]) -> None:
        self.kind, self.name = kind, name
        self.available = tuple(str(item) for item in available)
        super().__init__(f"no {kind} '{name}'; there are: {', '.join(self.available) or 'none'}")

    def __str__(self) -> str:
        return str(self.args[0])


class StateError(SaphariError, ValueError):
    """A measured or given state has the wrong size or is not finite."""


class SensorError(SaphariError, RuntimeError):
    """A sensor cannot be started, or its data cannot be read."""


class StabilityWarning(UserWarning):
    """A set of gains can oscillate with the surroundings that were stated."""
