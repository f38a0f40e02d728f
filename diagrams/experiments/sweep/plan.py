"""What a sweep runs: an experiment's case, what is set for all trials, and what varies from one to the next."""

from __future__ import annotations

import re
import sys
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.simulation.runner.experiment import Experiment, scenarios_of
from saphari_drake.simulation.runner.scenario import checked, load_tree, merged, to_tree

SCRIPTS = Path(__file__).resolve().parents[2]
KINDS = ("uniform", "log_uniform", "choice")
PART = re.compile(r"[^.\[\]]+|\[\d+\]")


@dataclass(frozen=True)
class Plan:
    """All that tells one sweep from another; plain values, so that it can be written and sent.

    Attributes
    ----------
    script, case : str
    seed : int or None
        None: that of the case.
    settings : tuple of str
        PATH=VALUE, for all trials.
    tree : dict
        Further parameters of all trials, nested, as in a scenario file.
    vary : dict
        By the dotted name of a parameter, ``pushes[0].force`` for one of a list: how it is drawn, one of
        ``{uniform: [low, high]}``, ``{log_uniform: [low, high]}``, ``{choice: [...]}``.
    """

    script: str
    case: str
    seed: int | None = None
    settings: tuple[str, ...] = ()
    tree: dict[str, Any] = field(default_factory=dict)
    vary: dict[str, dict[str, list[Any]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, drawn in self.vary.items():
            if not isinstance(drawn, Mapping) or len(drawn) != 1 or next(iter(drawn)) not in KINDS:
                raise ParameterError(name, f"needs one of {', '.join(KINDS)}, got {drawn}")
            (kind, values), *_ = drawn.items()
            pair = isinstance(values, list) and (kind == "choice" or (len(values) == 2 and values[0] < values[1]))
            if not pair or not values or (kind == "log_uniform" and values[0] <= 0.0):
                raise ParameterError(name, f"cannot be drawn from {kind} {values}")

    def drawn(self, number: int) -> dict[str, Any]:
        """Return what varies in a trial; the same on every machine."""
        rng = np.random.default_rng([self.seed or 0, number, 31])
        return {name: value_at(self.vary[name], float(rng.random())) for name in self.vary}

    @property
    def document(self) -> dict[str, Any]:
        """The plan as plain values."""
        return {**vars(self), "settings": list(self.settings)}


def plan_of(document: Mapping[str, Any]) -> Plan:
    """Return a plan from what `Plan.document` gave."""
    return Plan(**{**document, "settings": tuple(document["settings"])})


def value_at(drawn: Mapping[str, list[Any]], share: float) -> Any:
    """Return the value of a parameter at a share (0 to 1) of its range."""
    (kind, values), *_ = drawn.items()
    if kind == "choice":
        return values[min(int(share * len(values)), len(values) - 1)]
    low, high = (float(value) for value in values)
    return low + share * (high - low) if kind == "uniform" else float(low * (high / low) ** share)


def read_vary(path: Path) -> dict[str, dict[str, list[Any]]]:
    """Read what varies, a parameter a line."""
    return load_tree(path)


def find_experiment(script: str, folder: Path = SCRIPTS) -> Experiment:
    """Return the experiment of a script in `diagrams`.

    Raises
    ------
    UnknownNameError
        If there is no such script; the message lists those that exist.
    """
    known = [path.stem for path in sorted(folder.glob("*.py")) if "\nEXPERIMENT" in path.read_text(encoding="utf-8")]
    if script not in known:
        raise UnknownNameError("experiment", script, known)
    name = f"script_{script}"
    if name not in sys.modules:
        spec = spec_from_file_location(name, folder / f"{script}.py")
        if spec is None or spec.loader is None:
            raise ParameterError("experiment", f"'{script}' cannot be imported")
        sys.modules[name] = module_from_spec(spec)  # where dataclasses look their annotations up
        spec.loader.exec_module(sys.modules[name])
    experiment: Experiment = sys.modules[name].EXPERIMENT
    return experiment


def scenario_of(experiment: Experiment, plan: Plan, number: int, values: Mapping[str, Any]) -> Any:
    """Return the scenario of a trial: of random cases the trial of that number, of others the seed so much later.

    `values` are of the parameters that vary, by their dotted names.
    """
    options = Namespace(
        case=[plan.case], scenario=None, seed=plan.seed, duration=None, plant=None, model=None, quick=False
    )
    options.set = list(plan.settings)
    (scenario,) = scenarios_of(experiment, options)
    scenario = merged(scenario, plan.tree)
    if plan.case == "random":
        scenario.trial = number
    else:
        scenario.seed += number
    tree = to_tree(scenario)
    for name, value in values.items():
        put(tree, name, value)
    return checked(merged(scenario, tree))


def put(tree: Any, name: str, value: Any) -> None:
    """Set one value in nested dictionaries and lists by its dotted name."""
    *way, last = PART.findall(name)
    try:
        for part in way:
            tree = tree[int(part[1:-1]) if part[0] == "[" else part]
        key = int(last[1:-1]) if last[0] == "[" else last
        tree[key]
    except (KeyError, IndexError, TypeError):
        raise UnknownNameError("parameter", name, list(tree) if isinstance(tree, dict) else []) from None
    tree[key] = value
