"""Trials of faults on one case in one process: each short, with a fault soon after the start."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.analysis import Simulator

from saphari_drake.errors import UnknownNameError
from saphari_drake.simulation.faults.registry import STATIC, require_faults
from saphari_drake.simulation.faults.watch import Answer, answer
from saphari_drake.simulation.runner.scenario import checked

NOTHING = Answer(np.inf, np.inf, np.nan)  # of a diagram without a watch
AFTER = 0.6  # s; how long a run goes on after its fault


class Trial(NamedTuple):
    """A case whose runs are short: faults begin at a time (s) between these two, drawn from the seed."""

    script: str
    case: str
    earliest: float
    latest: float

    @property
    def name(self) -> str:
        """SCRIPT/CASE."""
        return f"{self.script}/{self.case}"

    def start(self, seed: int) -> float:
        """Return when the fault begins with a seed (s)."""
        return float(np.random.default_rng([seed, 9]).uniform(self.earliest, self.latest))


def run_trial(trial: Trial, fault: str, seed: int, plant: str = "ideal") -> dict[str, Any]:
    """Simulate one trial; return its reaction, when it was observable, and the largest joint speed over its limit."""
    experiment = importlib.import_module(trial.script).EXPERIMENT
    scenario = experiment.scenario_for(trial.case)
    scenario.seed, scenario.fault_time, scenario.faults, scenario.plant = seed, trial.start(seed), [fault], plant
    require_faults(scenario.faults, experiment.parts(trial.case))
    diagram = experiment.build_diagram(checked(scenario))
    simulator = Simulator(diagram)
    simulator.AdvanceTo((trial.latest if fault in STATIC else scenario.fault_time) + AFTER)
    became = answer(diagram, simulator.get_context()) or NOTHING
    return {
        "fault": fault,
        "seed": seed,
        "start": scenario.fault_time,
        "observable": became.observable,
        "told": became.time,
        "reaction": became.reaction,
        "speed_share": became.speed_share,
    }


def run_trials(trial: Trial, faults: Sequence[str], seeds: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Simulate all trials of a case, one after the other; a fault that the case cannot have is left out."""
    for fault in faults:
        for seed in seeds:
            try:
                yield run_trial(trial, fault, seed)
            except UnknownNameError:
                break


def main(argv: Sequence[str]) -> int:
    """Print a JSON line a trial: SCRIPT CASE EARLIEST LATEST FAULT,… SEED,…."""
    trial = Trial(argv[0], argv[1], float(argv[2]), float(argv[3]))
    for result in run_trials(trial, argv[4].split(","), [int(seed) for seed in argv[5].split(",")]):
        print(json.dumps(result), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
