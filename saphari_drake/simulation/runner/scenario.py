"""Scenarios: nested parameter dataclasses, read from and written to YAML, with any field set by its dotted name.

Drake's `yaml_load_typed` and `yaml_dump_typed` convert the values. Names are looked up here, so that an error tells the
whole path and what exists. Of the alternatives of a field a tag chooses one: ``controller: !SomeParameters {…}``.
Drake takes annotations as they are: a module of parameters does not postpone them.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml  # type: ignore[import-untyped]
from pydrake.common.yaml import yaml_dump, yaml_dump_typed, yaml_load_data, yaml_load_typed

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.parameters import validate

S = TypeVar("S")
_WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "text", Path: "a path"}


def merged(scenario: S, tree: Mapping[str, Any]) -> S:
    """Return a copy of a scenario in which the fields named by `tree` (nested, partial) have the values given there.

    Raises
    ------
    UnknownNameError
        If a name or a tag does not exist; the message lists those that do.
    ParameterError
        If a value has the wrong type.
    """
    return _merge(copy.deepcopy(scenario), tree, "")


def with_assignments(scenario: S, assignments: Sequence[str]) -> S:
    """Return a copy of a scenario with each ``PATH=VALUE`` applied; VALUE is read as YAML."""
    for text in assignments:
        path, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not path:
            raise ParameterError("--set", f"needs PATH=VALUE, got '{text}'")
        nested = functools.partial(functools.reduce, lambda tree, name: {name: tree}, path.split(".")[::-1])
        try:
            parsed = yaml_load_data(value, private=True)
        except yaml.YAMLError as error:
            raise ParameterError(path, f"'{value}' is not a YAML value") from error
        try:
            scenario = merged(scenario, nested(parsed))
        except ParameterError as error:
            # YAML reads some words as values (on, off, 3); a text field takes them as they were typed.
            try:
                scenario = merged(scenario, nested(value))
            except ParameterError:
                raise error from None
    return scenario


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
        tree = yaml_load_data(Path(path).read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(str(path), f"not YAML: {error}") from error
    if tree is not None and not isinstance(tree, dict):
        raise ParameterError(str(path), "needs names with values (name: value)")
    return tree or {}


def to_tree(scenario: Any) -> dict[str, Any]:
    """Return a scenario as nested dictionaries, lists and plain values."""
    return dict(yaml_load_data(yaml_dump_typed(scenario), private=True))


def _merge(target: S, tree: Any, prefix: str) -> S:
    """Set the fields of a dataclass in place and return it."""
    if not isinstance(tree, Mapping):
        raise ParameterError(prefix.rstrip("."), f"holds parameters of its own, cannot be {tree!r}")
    hints = {item.name: item.type for item in dataclasses.fields(target)}  # type: ignore[arg-type]
    for name, value in tree.items():
        if name not in hints:
            raise UnknownNameError("parameter", f"{prefix}{name}", [f"{prefix}{item}" for item in hints])
        setattr(target, name, _converted(getattr(target, name), hints[name], value, f"{prefix}{name}"))
    return target


def _converted(current: Any, hint: Any, value: Any, path: str) -> Any:
    """Return `value` as the annotation `hint` wants it; what it does not tell of parameters is taken from `current`."""
    origin = typing.get_origin(hint)
    kinds: tuple[Any, ...] = typing.get_args(hint)
    if origin is list and hasattr(kinds[0], "__dataclass_fields__") and isinstance(value, list):
        return [_merge(kinds[0](), item, f"{path}[{i}].") for i, item in enumerate(value)]
    kinds = kinds if origin in (typing.Union, types.UnionType) else (hint,)
    classes: dict[str, Any] = {kind.__name__: kind for kind in kinds if hasattr(kind, "__dataclass_fields__")}
    if not classes or (value is None and type(None) in kinds):
        listed = [kind for kind in kinds if (typing.get_origin(kind) is list) == isinstance(value, list)]
        return _read(value, listed[0] if len(kinds) > 1 and listed else hint, path)
    if isinstance(value, Mapping) and "_tag" in value:
        tag = value["_tag"].removeprefix("!")
        if tag not in classes:
            raise UnknownNameError(f"kind of {path}", f"!{tag}", [f"!{name}" for name in classes])
        value = {name: item for name, item in value.items() if name != "_tag"}
        current = current if type(current) is classes[tag] else classes[tag]()
    return _merge(next(iter(classes.values()))() if current is None else current, value, f"{path}.")


def _read(value: Any, kind: Any, path: str) -> Any:
    """Let Drake convert a value; a list is not made of a text's letters."""
    if value == {} and typing.get_origin(kind) is dict:
        return {}  # Drake would keep what is there: nothing
    holder = dataclasses.make_dataclass("Holder", [("value", kind, None)])
    try:
        if isinstance(value, str) and typing.get_origin(kind) is list:
            raise ValueError("not a list")
        return yaml_load_typed(schema=holder, data=yaml_dump({"value": value})).value
    except (RuntimeError, ValueError, TypeError, AssertionError) as error:
        raise ParameterError(path, f"needs {_WORDS.get(kind, kind)}, got {value!r}") from error
