"""An elastic ball pushes the arm at its fourth joint while the end effector stays (Section 5, first experiments).

At rest the ball (1200 N/m) and the springs of the null space (720 N/m there) share its stroke of 50 mm: 22 N. While
the arm still yields, its damping adds to that: the force is largest, about 33 N, when the ball stops.
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from experiments.null_space.ball_trials import PANELS, RandomBallParameters, ball_metrics, ball_trial, run_ball
from experiments.null_space.figures import comparison
from experiments.null_space.run import CASES as OBSERVERS
from experiments.null_space.run import NullSpaceScenario, Run, Runs, build, limits, replay, speed
from experiments.placement.null_space import place_obstacles
from experiments.trials import RandomTrials, run_trials
from pydrake.systems.framework import Diagram

from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

CASES = {**OBSERVERS, "random": "momentum in random postures; the ball at random points, from random directions"}
RUNS = Runs()


@dataclass
class NullSpaceBallScenario(NullSpaceScenario, RandomTrials):
    """Everything a run depends on."""

    random: RandomBallParameters = field(default_factory=RandomBallParameters)


def scenario_for(case: str) -> NullSpaceBallScenario:
    """Return the scenario of a case."""
    scenario = NullSpaceBallScenario(case=case)
    scenario.system.controller.observer = "momentum" if case == "random" else case
    if case == "random":
        scenario.system.cell.ball.dwell, scenario.duration = 5.0, 10.5
    # The same in all cases; tests/benchmarks/gain_margins.py tells how far they may be off.
    scenario.system.controller.gamma = 1.0
    scenario.system.disturbance.rate = 80.0
    return scenario


def build_diagram(scenario: NullSpaceBallScenario) -> Diagram:
    """Return the diagram of a scenario; of random pushes that of the first one."""
    if scenario.case == "random":
        scenario = ball_trial(scenario, scenario.numbers[0])
    return build(scenario).diagram


def run(scenario: NullSpaceBallScenario, options: RunOptions) -> Outcome:
    """Run a scenario, and the same without an observer for comparison, and judge it."""
    if scenario.case == "random":
        return run_trials(
            scenario,
            lambda number, label: run_ball(scenario, number, options, label),
            ball_metrics,
            PANELS,
            f"Null-space compliance, ball: {CASES['random']}",
        )
    result, reference = RUNS.get(scenario, options), RUNS.get(scenario, observer="none")

    def draw():
        runs = {case: RUNS.get(scenario, observer=case) for case in OBSERVERS}
        return comparison(runs, "Ball of 1200 N/m at the fourth joint, end effector at rest (first set of experiments)")

    title = f"Null-space compliance, ball: {scenario.case} (green: contact force)"
    end = scenario.system.cell.ball.departure
    note = f"the ball stays until {end:.2f} s" if scenario.duration < end else ""
    return Outcome(
        judged(result, reference), result.log, draw, lambda path: replay(result, Path(path), title), note=note
    )


def judged(result: Run, reference: Run) -> list[Metric]:
    """Return the metrics of the contract, and those that explain them."""
    scenario, log = result.setup.scenario, result.log
    ball = scenario.system.cell.ball
    dwell = log.between(ball.departure - 0.5, ball.departure)
    force = np.linalg.norm(log["contact"][:, :3], axis=1)
    peak = Metric("peak_force_N", float(force.max()), "N")
    if log.time[-1] < ball.departure - 0.01:
        return [peak, *limits(result), *speed(result)]
    error = float(np.mean(result.error()[dwell]))
    low, high = -np.inf, 1e-5
    expected = steady_error(result, dwell)
    if scenario.case == "none":
        low, high = 0.99 * expected, 1.01 * expected
    elbow, elbow_none = float(result.elbow()[dwell].mean()), float(reference.elbow()[dwell].mean())
    estimate = -log["residual"][dwell] + log["contact_torque"][dwell]
    return [
        Metric("dwell_error_m", error, "m", low, high, "goes to zero with an observer"),
        Metric("dwell_error_expected_m", expected if scenario.case == "none" else 0.0, "m"),
        Metric("dwell_error_ratio", float(np.mean(reference.error()[dwell])) / error, "1"),
        Metric("transient_error_m", float(result.error().max()), "m", high=np.inf if scenario.case == "none" else 3e-4),
        Metric("elbow_displacement_m", elbow, "m", 0.99 * elbow_none, 1.01 * elbow_none, "compliant in the null space"),
        peak,
        Metric("dwell_force_N", float(force[dwell].mean()), "N"),
        Metric("residual_error_Nm", float(np.abs(estimate.mean(axis=0)).max()), "Nm"),
        *limits(result),
        *speed(result),
    ]


def steady_error(result: Run, rows: np.ndarray) -> float:
    """Return ‖K⁻¹ J_M^{#T} τ_ext‖ (m), the error that stays without an observer, from the true external torque."""
    log, controller = result.log, result.setup.parts.pipeline.controller
    q, torque = log["position"][rows].mean(axis=0), -log["contact_torque"][rows].mean(axis=0)
    task = controller.kinematics(evaluate_dynamics(result.setup.robot, q, np.zeros(len(q)))).task
    return float(np.linalg.norm((task.J_inv.T @ torque / controller.gains.K_x)[-3:]))


def quick(scenario: NullSpaceBallScenario) -> None:
    """Let the ball arrive, or take one trial, whole."""
    shorten(scenario, np.inf if scenario.case == "random" else scenario.system.cell.ball.arrival + 1.0)


EXPERIMENT = Experiment(
    "null_space_ball",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=place_obstacles,
    own_robot=frozenset({"random"}),
    parts=lambda case: ARM,
    quick=quick,
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
