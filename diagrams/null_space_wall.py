"""The end effector follows a path while the arm meets a padded wall near its fourth joint (Section 5, second set)."""

import sys
from pathlib import Path

import numpy as np
from experiments.null_space.figures import comparison
from experiments.null_space.motion import StraightMotionParameters
from experiments.null_space.run import CASES, NullSpaceScenario, Run, Runs, build, limits, replay, speed
from experiments.placement.null_space import place_obstacles
from pydrake.systems.framework import Diagram

from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

RUNS = Runs()


def scenario_for(case: str) -> NullSpaceScenario:
    """Return the scenario of a case."""
    scenario = NullSpaceScenario(case=case, duration=10.0, moving=True)
    scenario.motion = StraightMotionParameters(displacement=[0.0, 0.2, 0.0], travel_time=3.5)
    scenario.system.cell.obstacle = "wall"
    scenario.system.controller.observer = case
    scenario.system.controller.gamma = 1.0
    scenario.system.disturbance.rate = 80.0
    return scenario


def build_diagram(scenario: NullSpaceScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return build(scenario).diagram


def run(scenario: NullSpaceScenario, options: RunOptions) -> Outcome:
    """Run a scenario, the same without the wall and the same without an observer, and judge it."""
    result = RUNS.get(scenario, options)
    free, reference = RUNS.get(scenario, obstacle="nothing"), RUNS.get(scenario, observer="none")

    def draw():
        runs = {case: RUNS.get(scenario, observer=case) for case in CASES}
        return comparison(runs, "Padded wall at the fourth joint, end effector on a path (second set of experiments)")

    title = f"Null-space compliance, wall: {scenario.case} (green: contact force)"
    metrics = judged(result, free, reference)
    return Outcome(metrics, result.log, draw, lambda path: replay(result, Path(path), title))


def judged(result: Run, free: Run, reference: Run) -> list[Metric]:
    """Return the metrics of the contract, and those that explain them."""
    observed = result.setup.scenario.case != "none"
    none = rms(reference)
    force = np.linalg.norm(result.log["contact"][:, :3], axis=1)
    away = np.abs(result.log["position"] - free.log["position"]).max()
    return [
        Metric("tracking_error_max_m", result.error().max(), "m", high=5e-4 if observed else np.inf),
        Metric("tracking_error_rms_m", rms(result), "m", high=0.2 * none if observed else np.inf),
        Metric("tracking_error_free_max_m", free.error().max(), "m"),
        Metric("tracking_error_free_rms_m", rms(free), "m"),
        Metric("tracking_error_rms_ratio", rms(result) / none, "1"),
        Metric("peak_force_N", force.max(), "N"),
        Metric("contact_time_s", float(np.sum(force > 0.0)) * float(np.diff(result.log.time[:2])[0]), "s", low=1.0),
        Metric("joint_displacement_max_rad", float(away), "rad"),
        *limits(result),
        *speed(result),
    ]


def rms(run: Run) -> float:
    """Return the root mean square of the task error (m)."""
    return float(np.sqrt(np.mean(run.error() ** 2)))


EXPERIMENT = Experiment(
    "null_space_wall",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=place_obstacles,
    parts=lambda case: ARM,
    quick=lambda scenario: shorten(scenario, 4.0),
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
