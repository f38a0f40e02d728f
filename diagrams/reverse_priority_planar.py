"""Hard and soft unilateral constraints by reverse priority (Section 4, Fig. 4), and three levels on the LWR4."""

import sys
from dataclasses import dataclass, field

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from saphari_drake.robots import catalog
from saphari_drake.simulation.experiment import Experiment, Outcome, RunOptions, advance, main
from saphari_drake.simulation.priority_figures import planar_figure, planar_replay
from saphari_drake.simulation.priority_planar import (
    PlanarParameters,
    add_derived,
    build_planar,
    drake_baseline,
    judge_planar,
)

CASES = {
    "constrained": "y at the end of link 4 kept in ±0.5 m: upper bound hard, lower bound soft",
    "soft_off": "the hard upper bound alone",
    "unconstrained": "the end-effector task alone",
}


@dataclass
class ReversePriorityScenario:
    """Everything a run depends on."""

    case: str = "constrained"
    # Seed of everything random.
    seed: int = 0
    # s; simulated time. The planar path ends with its rest at the second goal.
    duration: float = 26.1
    # Catalog name, or path of a URDF or SDF.
    robot: str = "planar_6r"
    planar: PlanarParameters = field(default_factory=PlanarParameters)


def scenario_for(case: str) -> ReversePriorityScenario:
    """Return the scenario of a case."""
    return ReversePriorityScenario(case=case)


def build_diagram(scenario: ReversePriorityScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return build_planar(catalog.load(scenario.robot), scenario.planar, scenario.case).diagram


def run(scenario: ReversePriorityScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    cell = build_planar(catalog.load(scenario.robot), scenario.planar, scenario.case)
    simulator = Simulator(cell.diagram)
    simulator.set_target_realtime_rate(options.realtime_rate)
    advance(simulator, scenario.duration, scenario.case)
    log = cell.recorder.log(cell.diagram, simulator.get_context())
    add_derived(cell, log)
    metrics = judge_planar(cell, log, scenario.case) + drake_baseline(cell, log)
    title = f"Reverse priority: {CASES[scenario.case]} (layout of Fig. 4)"
    return Outcome(
        metrics, log, lambda: planar_figure(cell, log, title), lambda path: planar_replay(cell, log, path, title)
    )


EXPERIMENT = Experiment(
    name="reverse_priority_planar",
    summary=__doc__,
    cases=CASES,
    scenario_for=scenario_for,
    run=run,
    build_diagram=build_diagram,
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
