"""A mobile manipulator that keeps its distance from things and people by predictive control (Section 3, Fig. 2, 3)."""

import sys
from dataclasses import dataclass, field, replace

from experiments.nmpc.build import NmpcCell, build_nmpc
from experiments.nmpc.figures import mobile_figure, nmpc_replay
from experiments.nmpc.mobile import SEEN, MobileParameters, controller_for, mobile_job, random_person
from experiments.nmpc.mobile_judge import judge_mobile
from experiments.nmpc.run import simulate
from pydrake.systems.framework import Diagram

from saphari_drake.simulation.faults.people import changed
from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

CASES = {
    "1": "a path without obstacles",
    "2": "six obstacles in the objective",
    "3": "six obstacles in the objective and in the constraints",
    "nonholonomic": "a platform that cannot slip sideways, on a path that moves sideways",
    "human": "a person who reaches across the path; the controller is told where the person is",
    "human_seen": "the same person; the controller knows what a depth camera sees, and nothing else",
    "human_random": "a random person for each seed, whom a camera sees; computing takes its time",
}
BEHIND = (-1.0, 0.0, 0.0)  # where a person comes from who was not in view


@dataclass
class MobileScenario(PlantScenario):
    """Everything a run depends on."""

    case: str = "3"
    # s; simulated time: 300 control steps.
    duration: float = 30.0
    robot: str = "omnirob"
    job: MobileParameters = field(default_factory=MobileParameters)


def scenario_for(case: str) -> MobileScenario:
    """Return the scenario of a case."""
    scenario = MobileScenario(case=case)
    controller_for(case, scenario.job.cell.controller)
    return scenario


def _cell(scenario: MobileScenario, options: RunOptions | None = None) -> NmpcCell:
    params = scenario.job
    if scenario.case == "human_random":
        params = replace(params, person=random_person(params, scenario.seed))
    params.cell.watch.sampler.noise.seed = scenario.seed
    truth = scenario.truth(params.cell.time_step)
    job = mobile_job(scenario.known(scenario.loaded()), params, scenario.case)
    job = replace(job, obstacles=changed(job.obstacles, truth, BEHIND))
    meshcat = None if options is None else options.meshcat
    return build_nmpc(job, params.cell, meshcat, seen=scenario.case in SEEN, truth=truth)


def build_diagram(scenario: MobileScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return _cell(scenario).diagram


def run(scenario: MobileScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    cell = _cell(scenario, options)
    result = simulate(cell, scenario.duration, scenario.case, options)
    metrics: list[Metric] = judge_mobile(result, scenario.job, scenario.case)
    title = f"Predictive control of a mobile manipulator: {CASES[scenario.case]} (layout of Fig. 2 and 3)"
    view = ((4.5, -1.5, 3.0), (0.0, 2.5, 0.6))
    return Outcome(
        metrics,
        result.log,
        lambda: mobile_figure(result, title),
        lambda path: nmpc_replay(result, path, title, view),
    )


def parts_of(case: str) -> tuple[str, ...]:
    """Return what of a case a fault can act on."""
    return (*ARM, *(("person", "view", "camera") if case in SEEN else ("person", "view") if case == "human" else ()))


EXPERIMENT = Experiment(
    "nmpc_mobile_manipulator",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    seedless=frozenset(CASES) - set(SEEN),
    parts=parts_of,
    quick=lambda scenario: shorten(scenario, 5.0),
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
