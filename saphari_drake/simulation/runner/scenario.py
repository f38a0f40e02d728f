"""Scenarios: nested parameter dataclasses, read from and written to YAML, with any field set by its dotted name.

Values are checked against the annotations of the fields, which may be strings (postponed annotations). Afterwards
`saphari_drake.parameters.validate` runs the checks of the dataclasses themselves.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import types
import typing
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import yaml  # type: ignore[import-untyped]

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.parameters import validate

S = TypeVar("S")


def merged(scenario: S, tree: Mapping[str, Any]) -> S:
    """Return a copy of a scenario in which the fields named by `tree` (nested, partial) have the values given there.

    Raises
    ------
    UnknownNameError
        If a name does not exist; the message lists those that do.
    ParameterError
        If a value has the wrong type.
    """
    result = copy.deepcopy(scenario)
    _merge(result, tree, "")
    return result


def with_assignments(scenario: S, assignments: Sequence[str]) -> S:
    """Return a copy of a scenario with each ``PATH=VALUE`` applied; VALUE is read as YAML."""
    result = copy.deepcopy(scenario)
    for text in assignments:
        path, equals, value = text.partition("=")
        path = path.strip()
        if not equals or not path:
            raise ParameterError("--set", f"needs PATH=VALUE, got '{text}'")
        try:
            parsed = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise ParameterError(path, f"'{value}' is not a YAML value") from error
        *parents, name = path.split(".")
        tree: dict[str, Any] = {name: parsed}
        raw: dict[str, Any] = {name: value.strip()}
        for parent in reversed(parents):
            tree, raw = {parent: tree}, {parent: raw}
        try:
            _merge(result, tree, "")
        except (ParameterError, UnknownNameError) as error:
            # YAML reads some words as values (on, off, 3); a text field takes them as they were typed.
            try:
                _merge(result, raw, "")
            except (ParameterError, UnknownNameError) as second:
                raise (second if isinstance(error, UnknownNameError) else error) from None
    return result


def checked(scenario: S) -> S:
    """Run the checks of a scenario and of all it holds; return it."""
    try:
        validate(scenario)
    except (ParameterError, UnknownNameError):
        raise
    except (ValueError, TypeError) as error:
        raise ParameterError("scenario", str(error)) from error
    return scenario


def load_tree(path: str | Path) -> dict[str, Any]:
    """Read a scenario file into nested dictionaries.

    Raises
    ------
    OSError
        If the file cannot be read.
    ParameterError
        If it is not YAML, or not a mapping from names to values.
    """
    try:
        tree = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(str(path), f"not YAML: {error}") from error
    tree = {} if tree is None else tree
    if not isinstance(tree, dict):
        raise ParameterError(str(path), "needs names with values (name: value)")
    return tree


def loaded(default: S, path: str | Path) -> S:
    """Return a copy of a scenario, or of any parameter dataclass, with the values of a file, checked."""
    return checked(merged(default, load_tree(path)))


def to_tree(value: Any) -> Any:
    """Return a scenario as nested dictionaries, lists and plain values."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {item.name: to_tree(getattr(value, item.name)) for item in dataclasses.fields(value)}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): to_tree(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_tree(item) for item in value]
    if isinstance(value, Enum):
        return value.name
    return str(value) if isinstance(value, Path) else value


def dump(tree: Mapping[str, Any]) -> str:
    """Return the YAML text of a scenario tree; lists of numbers stay on one line."""
    return str(yaml.dump(dict(tree), Dumper=_Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True))


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_mapping(self, tag: str, mapping: Any, flow_style: bool | None = None) -> Any:
        return super().represent_mapping(tag, mapping, flow_style=not mapping)


def _merge(target: Any, tree: Any, prefix: str) -> None:
    if not isinstance(tree, Mapping):
        raise ParameterError(prefix.rstrip("."), f"holds parameters of its own, cannot be {tree!r}")
    hints = typing.get_type_hints(type(target))
    names = [item.name for item in dataclasses.fields(target)]
    for name, value in tree.items():
        if name not in names:
            raise UnknownNameError("parameter", f"{prefix}{name}", [f"{prefix}{item}" for item in names])
        current, hint, path = getattr(target, name), hints[name], f"{prefix}{name}"
        if isinstance(value, Mapping) and dataclasses.is_dataclass(current):
            _merge(current, value, f"{path}.")
        elif dataclasses.is_dataclass(hint):
            _merge(current, value, f"{path}.")
        else:
            object.__setattr__(target, name, _converted(value, hint, path))


def _converted(value: Any, hint: Any, path: str) -> Any:
    """Return `value` as the annotation `hint` wants it, or raise a `ParameterError` that says what it wants."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin in (typing.Union, types.UnionType):
        return _one_of(value, arguments, path)
    if origin is Literal:
        if value not in arguments:
            raise UnknownNameError(path, value, arguments)
        return value
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        result = hint()
        _merge(result, value, f"{path}.")
        return result
    if origin in (list, tuple) and isinstance(value, list):
        homogeneous = origin is list or (len(arguments) == 2 and arguments[1] is Ellipsis)
        if not homogeneous and len(arguments) != len(value):
            raise ParameterError(path, f"needs {len(arguments)} entries, got {len(value)}")
        wanted = [arguments[0]] * len(value) if homogeneous else arguments
        return origin(_converted(item, kind, f"{path}[{i}]") for i, (item, kind) in enumerate(zip(value, wanted)))
    if origin in (dict, Mapping) and isinstance(value, Mapping):
        return {str(key): _converted(item, arguments[1], f"{path}.{key}") for key, item in value.items()}
    if hint is np.ndarray or origin is np.ndarray:
        return _array(value, path)
    return _scalar(value, hint, path)


def _one_of(value: Any, hints: Sequence[Any], path: str) -> Any:
    errors = []
    for hint in hints:
        try:
            return _converted(value, hint, path)
        except (ParameterError, UnknownNameError) as error:
            errors.append(error)
    real = [error for hint, error in zip(hints, errors) if hint is not type(None)]
    raise real[0] if len(real) == 1 else ParameterError(path, f"cannot be {value!r}")


def _array(value: Any, path: str) -> np.ndarray:
    try:
        if isinstance(value, str | bool | Mapping) or value is None:
            raise ValueError
        return np.array(value, dtype=float)
    except (ValueError, TypeError) as error:
        raise ParameterError(path, f"needs a list of numbers, got {value!r}") from error


def _scalar(value: Any, hint: Any, path: str) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if hint is type(None) and value is None:
        return None
    if hint is float and (number or isinstance(value, str)):
        with contextlib.suppress(ValueError):
            return float(value)  # YAML 1.1 reads 1e-4 as text
    if hint is int and number and float(value).is_integer():
        return int(value)
    if (hint is bool and isinstance(value, bool)) or (hint is str and isinstance(value, str)):
        return value
    if hint is Path and isinstance(value, str):
        return Path(value)
    if isinstance(hint, type) and issubclass(hint, Enum):
        if value not in hint.__members__:
            raise UnknownNameError(path, value, hint.__members__)
        return hint[value]
    words = {float: "a number", int: "a whole number", bool: "true or false", str: "text", Path: "a path"}
    wanted = "a list" if typing.get_origin(hint) in (list, tuple) else words.get(hint, str(hint))
    raise ParameterError(path, f"needs {wanted}, got {value!r}")
