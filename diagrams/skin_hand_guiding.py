"""A person leads the arm by its end effector and, through a sensitive skin, by its body (Section 6, Fig. 9 and 10)."""

import sys
from pathlib import Path

import numpy as np
from experiments.guiding import judge
from experiments.guiding.figures import forces_and_velocities, replay
from experiments.guiding.run import GuidingRun, GuidingRuns, build
from experiments.guiding.touches import skin_metrics
from experiments.guiding.trials import PANELS, RandomGuidingScenario, draw_guiding, guiding_metrics, run_guiding
from experiments.placement.guiding import place_hands
from experiments.trials import run_trials
from pydrake.systems.framework import Diagram

from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.people.guiding_hands import Pull
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, NothingToJudgeError, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

CASES = {
    "end_effector_first": "the end effector is led; then a hand presses the body",
    "body_first": "the body is led through the skin; then a hand pulls the end effector",
    "recorded": "the end effector is led with the recorded force of a real person; then a hand presses the body",
    "random": "random postures, order of the hands, and forces of both",
}
FIGURES = {"end_effector_first": "layout of Fig. 9", "body_first": "layout of Fig. 10", "recorded": "layout of Fig. 9"}
SYNTHETIC = Path(__file__).parent / "data" / "hand_guiding_force.csv"
STRONGER = 3.0


def scenario_for(case: str) -> RandomGuidingScenario:
    """Return the scenario of a case."""
    scenario = RandomGuidingScenario(case=case)
    # The noise of the wrist sensor, fed forward, shakes a wrist of 0.1 kg effective mass: firm gains and a smoothed
    # force keep it below what the second hand does. All cases have the same gains; tests/benchmarks/gain_margins.py
    # tells how far they may be off.
    controller = scenario.system.pipeline.controller
    controller.K_P, controller.K_D, controller.force_time, controller.hand_stiffness = 6400.0, 160.0, 0.005, 2000.0
    if case == "body_first":
        scenario.home[5] = -65.0
        scenario.body.pulls = [Pull(0.6, 2.4, 0.5, [0.5, 1.5, -4.5]), Pull(2.5, 2.8, 0.5, [-1.0, -2.0, -4.0])]
        scenario.end_effector.pulls = [Pull(1.7, 1.2, 0.4, [3.0, 0.0, 3.0]), Pull(3.5, 1.3, 0.4, [-3.0, 2.0, -2.5])]
        return scenario
    scenario.end_effector.pulls = [
        Pull(0.6, 1.7, 0.5, [6.5, 0.0, 0.0]),
        Pull(1.8, 1.7, 0.5, [-5.5, 0.0, 4.0]),
        Pull(3.0, 1.9, 0.5, [0.0, -5.5, -3.0]),
    ]
    scenario.body.pulls = [Pull(2.0, 1.1, 0.45, [1.5, 1.0, -3.6]), Pull(3.4, 1.1, 0.45, [-1.5, -1.5, -3.6])]
    return scenario


def build_diagram(scenario: RandomGuidingScenario) -> Diagram:
    """Return the diagram of a scenario; of random trials that of the first one."""
    if scenario.case == "random":
        scenario = draw_guiding(scenario, scenario_for, scenario.numbers[0])
    return build(scenario, SYNTHETIC).diagram


def run(scenario: RandomGuidingScenario, options: RunOptions) -> Outcome:
    """Run a scenario as it is, without the second hand and with a stronger one, and judge it."""
    if scenario.case == "random":
        return run_trials(
            scenario,
            lambda number, _: run_guiding(draw_guiding(scenario, scenario_for, number), number, SYNTHETIC, options),
            guiding_metrics,
            PANELS,
            f"Hand guiding, {CASES['random']}",
        )
    runs = GuidingRuns(scenario, SYNTHETIC, options)
    result, alone, stronger = runs.get(), runs.get(0.0), runs.get(STRONGER)
    title = f"Hand guiding, {CASES[scenario.case]}\n({FIGURES[scenario.case]}; dotted: the first hand alone)"
    metrics, note = limits(result, stronger), ""
    try:
        metrics = [*judged(result, alone, stronger), *metrics]
    except NothingToJudgeError as error:
        note = str(error)
    return Outcome(
        metrics,
        result.log,
        lambda: forces_and_velocities(result, alone, title),
        lambda path: replay(result, path, f"Hand guiding: {scenario.case} (orange: end effector, blue: body)"),
        note=note,
    )


def judged(result: GuidingRun, alone: GuidingRun, stronger: GuidingRun) -> list[Metric]:
    """Return the metrics of the contract, and those that explain them."""
    speeds = [float(np.linalg.norm(judge.true_velocity(result, hand), axis=1).max()) for hand in (0, 1)]
    return [
        Metric("main_task_disturbance", judge.main_task_disturbance(result, alone), "1", high=0.02,
               reported="only affected by its own force"),
        Metric("main_task_disturbance_3x", judge.main_task_disturbance(stronger, alone), "1", high=0.02),
        *skin_metrics(judge.touches_of(result)),
        *skin_metrics(judge.touches_of(stronger), "_3x"),
        Metric("secondary_realised", judge.secondary_realised(result), "1", 0.98, 1.02, "motion in the null space"),
        Metric("secondary_realised_3x", judge.secondary_realised(stronger), "1"),
        Metric("main_velocity_error_relative", judge.velocity_error(result), "1",
               reported="moves according to the force"),
        Metric("speed_max_end_effector_m_s", speeds[0], "m/s"),
        Metric("speed_max_body_m_s", speeds[1], "m/s"),
        Metric("rank_second", float(np.median(_second_rank(result))), "1"),
        Metric("torque_step_max_Nm", judge.torque_step(result), "Nm"),
    ]  # fmt: skip


def limits(result: GuidingRun, stronger: GuidingRun) -> list[Metric]:
    """Return how far both runs use the joints' limits, and how fast the first one was."""
    parts = (np.vstack([run.fast[name] for run in (result, stronger)]) for name in ("velocity", "torque_excess"))
    factor = result.setup.scenario.duration / result.wall
    return [*limit_metrics(result.setup.robot, *parts), Metric("real_time_factor", factor, "1", 0.25, decides=False)]


def _second_rank(result: GuidingRun) -> np.ndarray:
    ranks = result.log["rank"][:, 1 - result.setup.scenario.main]
    return ranks[ranks > 0] if np.any(ranks > 0) else np.zeros(1)


EXPERIMENT = Experiment(
    "skin_hand_guiding",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=place_hands,
    own_robot=frozenset({"random"}),
    parts=lambda case: (*ARM, "skin", "wrist"),
    quick=lambda scenario: shorten(scenario, 3.2),  # both hands have touched by then
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
