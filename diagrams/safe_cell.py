"""A robot at work beside people who come near, touch it and lead it: all methods under one supervisor.

No claim of compliance: the monitors compute the standard's formulas, with limits written down from memory; check them
against a licensed copy.
"""

import sys

import numpy as np
from experiments.cell.build import build_cell
from experiments.cell.figures import cell_figure, cell_replay
from experiments.cell.functions import safety_functions
from experiments.cell.run import metrics_of, simulate
from experiments.cell.scenario import FARTHER, CellScenario
from pydrake.systems.framework import Diagram

from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

# N, N and Nm; what of a platform of 250 kg counts as a touch: a fifth of what its drives give. Assumed.
PLATFORM_THRESHOLD = (300.0, 300.0, 120.0)
CASES = {"fixed": "a LWR4 on a fixed base", "mobile": "the omniRob with its arm"}


def scenario_for(case: str) -> CellScenario:
    """Return the scenario of a case."""
    scenario = CellScenario(case=case, robot="lwr4" if case == "fixed" else "omnirob")
    if case == "mobile":
        # The person stands beside the path as beside that of the fixed arm, not on it.
        person = scenario.person
        person.way = [[time, x + FARTHER[0], y] for time, x, y in person.way]
        person.reach_to = np.add(person.reach_to, FARTHER).tolist()
        scenario.pipeline.detector.threshold = [*PLATFORM_THRESHOLD, *[1.5] * 7]
    return scenario


def build_diagram(scenario: CellScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return build_cell(scenario).diagram


def run(scenario: CellScenario, options: RunOptions) -> Outcome:
    """Run all trials in all ways, and judge them; figure and replay show the first run."""
    runs = [
        simulate(scenario, trial, way, options if (trial, k) == (0, 0) else RunOptions(answered=options.answered))
        for trial in range(scenario.trials)
        for k, way in enumerate(scenario.ways)
    ]
    first = runs[0]
    title = f"Safe cell, {CASES[scenario.case]}."
    return Outcome(
        metrics_of(runs, scenario),
        first.slow,
        lambda: cell_figure(first, title),
        lambda path: cell_replay(first, path, title),
        {"safety_functions.md": safety_functions([run for run in runs if run.way == first.way])},
    )


def quick(scenario: CellScenario) -> None:
    """Let the person come and touch the robot once, under the supervisor alone."""
    scenario.ways = scenario.ways[:1]
    shorten(scenario, 4.0)


EXPERIMENT = Experiment(
    "safe_cell",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    parts=lambda case: (*ARM, "skin", "wrist", "camera"),
    quick=quick,
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
