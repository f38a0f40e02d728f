"""The file of results: read, merged and written so that a change of one figure is a change of one line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.record.files import write_text

DIGITS = 6
Cases = dict[str, dict[str, Any]]  # by case
Results = dict[str, Cases]  # by script


def read_results(path: Path) -> Results:
    """Return what is recorded, by script and case; nothing if there is no file."""
    if not path.is_file():
        return {}
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ParameterError(path.name, f"is no JSON: {error}") from error


def merge(old: Results, new: Mapping[tuple[str, str], dict[str, Any]], order: list[tuple[str, str]]) -> Results:
    """Return the results of `new` in place of the old ones, in the given order; what is not in it is left out."""
    merged: Results = {}
    for script, case in order:
        summary = new.get((script, case), old.get(script, {}).get(case))
        if summary is not None:
            merged.setdefault(script, {})[case] = summary
    return merged


def write_results(path: Path, results: Any) -> None:
    """Write a file of results; numbers get six digits."""
    write_text(path, dump(rounded(results)) + "\n")


def rounded(value: Any) -> Any:
    """Return a tree with its floats rounded to six digits, whole ones as integers."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(item) for item in value]
    if not isinstance(value, float):
        return value
    short = float(f"{value:.{DIGITS}g}")
    return int(short) if short.is_integer() and abs(short) < 1e9 else short


def dump(value: Any, indent: str = "") -> str:
    """Return JSON in which every table that holds no other is one line."""
    if not isinstance(value, dict) or not any(isinstance(item, dict) for item in value.values()):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    deeper = indent + "  "
    lines = [f"{deeper}{json.dumps(key, ensure_ascii=False)}: {dump(item, deeper)}" for key, item in value.items()]
    return "{\n" + ",\n".join(lines) + f"\n{indent}" + "}"
