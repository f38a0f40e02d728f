"""A manipulator that reaches a pose and keeps its distance from obstacles by predictive control (Section 3, Fig. 1)."""

import sys
from dataclasses import dataclass, field

from experiments.nmpc.build import NmpcCell, build_nmpc
from experiments.nmpc.figures import manipulator_figure, nmpc_replay
from experiments.nmpc.manipulator import ManipulatorParameters, controller_for, judge_manipulator, manipulator_job
from experiments.nmpc.run import simulate
from experiments.placement.predictive import place_job
from pydrake.systems.framework import Diagram

from saphari_drake.robots import catalog
from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

CASES = {
    "none": "the pose alone",
    "objective": "obstacles in the objective",
    "constraints": "obstacles in the constraints",
    "both": "obstacles in the objective and in the constraints",
}


@dataclass
class ManipulatorScenario(PlantScenario):
    """Everything a run depends on."""

    case: str = "both"
    # s; simulated time.
    duration: float = 10.0
    job: ManipulatorParameters = field(default_factory=ManipulatorParameters)


def scenario_for(case: str) -> ManipulatorScenario:
    """Return the scenario of a case."""
    scenario = ManipulatorScenario(case=case)
    controller_for(case, scenario.job.cell.controller)
    return scenario


def _cell(scenario: ManipulatorScenario, options: RunOptions | None = None) -> NmpcCell:
    job = manipulator_job(scenario.known(catalog.load(scenario.robot)), scenario.job)
    truth = scenario.truth(scenario.job.cell.time_step)
    return build_nmpc(job, scenario.job.cell, None if options is None else options.meshcat, truth=truth)


def build_diagram(scenario: ManipulatorScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return _cell(scenario).diagram


def run(scenario: ManipulatorScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
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
    seedless=frozenset(CASES),
    parts=lambda case: ARM,
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
