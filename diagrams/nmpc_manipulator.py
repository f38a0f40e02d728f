"""A manipulator that reaches a pose and keeps its distance from obstacles by predictive control (Section 3, Fig. 1)."""

import sys
from dataclasses import dataclass, field

from experiments.nmpc.build import NmpcCell, build_nmpc
from experiments.nmpc.figures import manipulator_figure, nmpc_replay
from experiments.nmpc.manipulator import ManipulatorParameters, controller_for, judge_manipulator, manipulator_job
from experiments.nmpc.manipulator_trials import (
    PANELS,
    RandomJobParameters,
    manipulator_trial,
    manipulator_trial_metrics,
    run_manipulator_trial,
)
from experiments.nmpc.run import simulate
from experiments.placement.predictive import place_job
from experiments.trials import RandomTrials, run_trials
from pydrake.systems.framework import Diagram

from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

CASES = {
    "none": "the pose alone",
    "objective": "obstacles in the objective",
    "constraints": "obstacles in the constraints",
    "both": "obstacles in the objective and in the constraints",
    "random": "both, with random starts, goals and obstacles near the way",
}


@dataclass
class ManipulatorScenario(RandomTrials):
    """Everything a run depends on."""

    case: str = "both"
    # s; simulated time.
    duration: float = 10.0
    job: ManipulatorParameters = field(default_factory=ManipulatorParameters)
    random: RandomJobParameters = field(default_factory=RandomJobParameters)


def scenario_for(case: str) -> ManipulatorScenario:
    """Return the scenario of a case."""
    scenario = ManipulatorScenario(case=case)
    controller_for("both" if case == "random" else case, scenario.job.cell.controller)
    return scenario


def _cell(scenario: ManipulatorScenario, options: RunOptions | None = None) -> NmpcCell:
    job = manipulator_job(scenario.known(scenario.loaded()), scenario.job)
    truth = scenario.truth(scenario.job.cell.time_step)
    return build_nmpc(job, scenario.job.cell, None if options is None else options.meshcat, truth=truth)


def build_diagram(scenario: ManipulatorScenario) -> Diagram:
    """Return the diagram of a scenario; of random jobs that of the first one."""
    if scenario.case == "random":
        scenario = manipulator_trial(scenario, scenario.numbers[0])
    return _cell(scenario).diagram


def run(scenario: ManipulatorScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    if scenario.case == "random":
        title = f"Predictive control of a manipulator: {CASES['random']}"
        return run_trials(
            scenario,
            lambda number, label: run_manipulator_trial(scenario, number, options, label),
            manipulator_trial_metrics,
            PANELS,
            title,
        )
    result = simulate(_cell(scenario, options), scenario.duration, scenario.case, options)
    title = f"Predictive control of a manipulator: {CASES[scenario.case]} (layout of Fig. 1)"
    view = ((2.0, -1.4, 1.3), (0.1, 0.0, 0.5))
    return Outcome(
        judge_manipulator(result, scenario.job, scenario.case),
        result.log,
        lambda: manipulator_figure(result, title),
        lambda path: nmpc_replay(result, path, title, view),
    )


EXPERIMENT = Experiment(
    "nmpc_manipulator",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=place_job,
    own_robot=frozenset({"random"}),
    seedless=frozenset(CASES) - {"random"},
    parts=lambda case: ARM,
    quick=lambda scenario: shorten(scenario, 5.0),  # the goal is reached by then
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
