"""The experiment scripts of a folder, their cases and default seeds."""

from __future__ import annotations

import importlib.util
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from saphari_drake.errors import ParameterError, UnknownNameError

REALISTIC = "/realistic"  # after the name of a case: the same on the realistic plant
DEFINES = re.compile(r"^EXPERIMENT\b", re.MULTILINE)


@dataclass(frozen=True)
class Script:
    """An experiment script.

    Attributes
    ----------
    path : Path
    default_seeds : mapping from str to int
        The seed that each case takes if none is given, in the script's order of cases; then the same cases on the
        realistic plant, where they have one.
    seedless : frozenset of str
        The cases in which a seed changes nothing.
    """

    path: Path
    default_seeds: Mapping[str, int]
    seedless: frozenset[str] = frozenset()


def find_scripts(folder: Path) -> dict[str, Script]:
    """Return the scripts of a folder that define EXPERIMENT, by name, in alphabetical order."""
    paths = [path for path in sorted(folder.glob("*.py")) if DEFINES.search(path.read_text(encoding="utf-8"))]
    if not paths:
        raise ParameterError("folder", f"no script in '{folder}' defines EXPERIMENT")
    return {path.stem: _script(path) for path in paths}


def select(scripts: Mapping[str, Script], only: Sequence[str]) -> list[tuple[str, str]]:
    """Return (script, case) of everything that `only` names as SCRIPT or SCRIPT/CASE; of all if it is empty.

    SCRIPT/CASE/realistic is that case on the realistic plant.
    """
    every = [(name, case) for name, script in scripts.items() for case in script.default_seeds]
    wanted: set[tuple[str, str]] = set()
    for text in only:
        name, _, case = text.partition("/")
        if name not in scripts:
            raise UnknownNameError("script", name, list(scripts))
        if case and case not in scripts[name].default_seeds:
            raise UnknownNameError(f"case of {name}", case, list(scripts[name].default_seeds))
        wanted |= {pair for pair in every if pair[0] == name and case in ("", pair[1])}
    return [pair for pair in every if pair in wanted] if only else every


def _script(path: Path) -> Script:
    spec = importlib.util.spec_from_file_location(f"script_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ParameterError("script", f"'{path}' cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look their annotations up
    spec.loader.exec_module(module)
    experiment = module.EXPERIMENT
    seeds = {case: experiment.scenario_for(case).seed for case in experiment.cases}
    plants = {case: getattr(experiment.scenario_for(case), "plant", "") for case in experiment.cases}
    seeds |= {case + REALISTIC: seeds[case] for case, plant in plants.items() if plant == "ideal"}
    return Script(path, seeds, experiment.seedless)
