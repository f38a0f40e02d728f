"""What joint friction and a payload that the controller does not know do to the task (Section 5, ball experiment)."""

import sys
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import Diagram

from saphari_drake.simulation.experiment import Experiment, Metric, Outcome, RunOptions, main
from saphari_drake.simulation.figures import CYCLE, blank, legend
from saphari_drake.simulation.null_space_run import CASES, NullSpaceScenario, Run, Runs, build, replay

RUNS = Runs()


@dataclass
class RobustnessScenario(NullSpaceScenario):
    """The ball experiment with what the model does not know."""

    # Share of the reported joint friction in the conditions with friction.
    friction_share: float = 0.5
    # kg; payload in the conditions with payload.
    payload: float = 1.0


def scenario_for(case: str) -> RobustnessScenario:
    """Return the scenario of a case: time to settle under friction and payload before the ball comes."""
    scenario = RobustnessScenario(case=case, duration=12.0)
    scenario.system.controller.observer = case
    scenario.system.controller.gamma = 1.0
    scenario.system.disturbance.rate = 80.0
    scenario.system.cell.ball.start, scenario.system.cell.ball.dwell = 4.0, 4.0
    return scenario


def conditions(scenario: RobustnessScenario) -> dict[str, tuple[float, float]]:
    """Return friction share and payload (kg) of each condition."""
    friction, payload = scenario.friction_share, scenario.payload
    return {"exact": (0.0, 0.0), "friction": (friction, 0.0), "payload": (0.0, payload), "both": (friction, payload)}


def with_condition(scenario: RobustnessScenario, friction: float, payload: float) -> RobustnessScenario:
    """Set a condition in the simulated world alone."""
    scenario.system.cell.friction_share, scenario.system.cell.payload = friction, payload
    return scenario


def build_diagram(scenario: RobustnessScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return build(with_condition(scenario, scenario.friction_share, scenario.payload)).diagram


def run(scenario: RobustnessScenario, options: RunOptions) -> Outcome:
    """Run a case in all conditions and judge each."""
    runs = {
        name: RUNS.get(with_condition(scenario, *condition), options)
        for name, condition in conditions(scenario).items()
    }
    metrics = [metric for name, result in runs.items() for metric in judged(name, result)]

    def draw():
        figure, axes = blank(1, 1, f"Task error with friction and payload unknown to the controller: {scenario.case}")
        for (name, result), color in zip(runs.items(), CYCLE):
            axes[0, 0].plot(result.log.time, 1e3 * result.error(), color=color, label=name)
        axes[0, 0].set_ylabel("‖x̃‖ [mm]")
        axes[0, 0].set_xlabel("time [s]")
        legend(axes[0, 0])
        return figure

    last = runs["both"]
    title = f"Null-space compliance with friction and payload: {scenario.case}"
    return Outcome(metrics, last.log, draw, lambda path: replay(last, path, title))


def judged(name: str, result: Run) -> list[Metric]:
    """Return the task error at rest before contact, during the dwell, and its largest value from then on."""
    ball, log, error = result.setup.scenario.system.cell.ball, result.log, result.error()
    before = log.between(ball.start - 0.5, ball.start)
    dwell = log.between(ball.departure - 0.5, ball.departure)
    return [
        Metric(f"{name}_settled_error_m", float(np.mean(error[before])), "m"),
        Metric(f"{name}_dwell_error_m", float(np.mean(error[dwell])), "m"),
        Metric(f"{name}_error_max_m", float(np.max(error[log.between(ball.start, log.time[-1])])), "m"),
    ]


EXPERIMENT = Experiment(
    name="null_space_robustness",
    summary=__doc__,
    cases=CASES,
    scenario_for=scenario_for,
    run=run,
    build_diagram=build_diagram,
    accepts_model=True,
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
