"""Hard and soft unilateral constraints by reverse priority (Section 4, Fig. 4), and three levels on an arm."""

import sys
from dataclasses import dataclass, field

from experiments.placement.priority import place_levels
from experiments.priority.figures import planar_figure, planar_replay, three_level_figure, three_level_replay
from experiments.priority.planar import (
    PlanarCell,
    PlanarParameters,
    add_derived,
    build_planar,
    drake_baseline,
    judge_planar,
)
from experiments.priority.three_level import ThreeLevelParameters, three_level_job, with_faults
from experiments.priority.three_level_build import (
    ThreeLevelCell,
    add_three_level_signals,
    build_three_level,
    drake_three_level,
    judge_three_level,
)
from experiments.priority.three_level_trials import (
    PANELS,
    RandomPersonParameters,
    build_person,
    person_metrics,
    run_person,
)
from experiments.trials import RandomTrials, run_trials
from pydrake.systems.framework import Diagram

from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation

CASES = {
    "constrained": "y at the end of link 4 kept in ±0.5 m: upper bound hard, lower bound soft",
    "soft_off": "the hard upper bound alone",
    "unconstrained": "the end-effector task alone",
    "three_level": "LWR4 with torques: joint limits and a person whose place it is told, a path, a soft elbow region",
    "random": "three_level in random postures, with random circles and people",
}


@dataclass
class ReversePriorityScenario(RandomTrials):
    """Everything a run depends on; the seed is also of the person's motion beside the LWR4."""

    case: str = "constrained"
    # s; simulated time. The planar path ends with its rest at the second goal.
    duration: float = 26.1
    robot: str = "planar_6r"
    # The planar cases.
    planar: PlanarParameters = field(default_factory=PlanarParameters)
    # The cases three_level and random.
    arm: ThreeLevelParameters = field(default_factory=ThreeLevelParameters)
    random: RandomPersonParameters = field(default_factory=RandomPersonParameters)


def scenario_for(case: str) -> ReversePriorityScenario:
    """Return the scenario of a case."""
    if case == "three_level":
        return ReversePriorityScenario(case=case, duration=12.0, robot="lwr4")
    if case == "random":
        return ReversePriorityScenario(case=case, duration=8.0, robot="lwr4")
    return ReversePriorityScenario(case=case)


def build_diagram(scenario: ReversePriorityScenario) -> Diagram:
    """Return the diagram of a scenario; of random jobs that of the first one."""
    if scenario.case == "random":
        return build_person(scenario, scenario.numbers[0]).diagram
    if scenario.case == "three_level":
        return _three_level(scenario).diagram
    return _planar(scenario).diagram


def _three_level(scenario: ReversePriorityScenario, options: RunOptions | None = None) -> ThreeLevelCell:
    truth, meshcat = scenario.truth(scenario.arm.controller.period), None if options is None else options.meshcat
    job = three_level_job(scenario.known(scenario.loaded(scenario.arm.home)), scenario.arm, scenario.seed)
    return build_three_level(with_faults(job, truth), meshcat, truth)


def _planar(scenario: ReversePriorityScenario) -> PlanarCell:
    truth = scenario.truth(scenario.planar.controller.period)
    return build_planar(scenario.known(scenario.loaded()), scenario.planar, scenario.case, truth)


def run(scenario: ReversePriorityScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    if scenario.case == "random":
        return run_trials(
            scenario,
            lambda number, label: run_person(scenario, number, options, label),
            person_metrics,
            PANELS,
            f"Reverse priority: {CASES['random']}",
        )
    return run_three_level(scenario, options) if scenario.case == "three_level" else run_planar(scenario, options)


def run_three_level(scenario: ReversePriorityScenario, options: RunOptions) -> Outcome:
    """Run the LWR4 among a moving person."""
    cell = _three_level(scenario, options)
    simulation = Simulation(cell.diagram, scenario.case, options)
    simulation.to(scenario.duration)
    log = simulation.log(cell.recorder)
    add_three_level_signals(cell, log)
    metrics = [
        *judge_three_level(cell, log),
        *drake_three_level(cell, log),
        Metric("real_time_factor", simulation.real_time_factor, "1", decides=False),
    ]
    title = f"Reverse priority: {CASES[scenario.case]}"
    return Outcome(
        metrics,
        log,
        lambda: three_level_figure(cell, log, title),
        lambda path: three_level_replay(cell, log, path, title),
    )


def run_planar(scenario: ReversePriorityScenario, options: RunOptions) -> Outcome:
    """Run the planar arm of Fig. 4."""
    cell = _planar(scenario)
    simulation = Simulation(cell.diagram, scenario.case, options)
    simulation.to(scenario.duration)
    log = simulation.log(cell.recorder)
    add_derived(cell, log)
    metrics = judge_planar(cell, log, scenario.case) + drake_baseline(cell, log, scenario.case)
    title = f"Reverse priority: {CASES[scenario.case]} (layout of Fig. 4)"
    return Outcome(
        metrics, log, lambda: planar_figure(cell, log, title), lambda path: planar_replay(cell, log, path, title)
    )


def parts_of(case: str) -> tuple[str, ...]:
    """Return what of a case a fault can act on; the planar arm has neither torques nor masses."""
    return (*ARM, "person", "view") if case in ("three_level", "random") else ("encoders", "controller")


EXPERIMENT = Experiment(
    "reverse_priority_planar",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=place_levels,
    own_robot=frozenset(CASES) - {"three_level"},
    seedless=frozenset(CASES) - {"three_level", "random"},
    parts=parts_of,
    quick=lambda scenario: shorten(scenario, 3.0),
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
