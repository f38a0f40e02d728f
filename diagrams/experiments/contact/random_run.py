"""Runs random touches one by one, each drawn from its own seed."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat

from experiments.contact.random_judge import (
    JudgedTouch,
    failures,
    is_seen,
    judged_touch,
    random_metrics,
    touch_log,
    touches_figure,
)
from experiments.contact.random_touches import RandomTouch, draw_touch
from experiments.contact.run import ContactSetup
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.command_line import say
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.simulation.world.cell import contact_truth

Build = Callable[[Any, Meshcat | None], ContactSetup]


class Trial(NamedTuple):
    """One random touch, and the scenario that runs it alone."""

    number: int
    drawn: RandomTouch
    scenario: Any


class TrialRun(NamedTuple):
    """A finished trial."""

    touch: JudgedTouch
    setup: ContactSetup
    log: Log


def trial_of(scenario: Any, number: int) -> Trial:
    """Return a trial of a `ContactScenario` with random touches; it is the same on every machine."""
    robot = scenario.loaded(scenario.home)
    drawn = draw_touch(robot, scenario.system.cell.hand, scenario.touches, [scenario.seed, number])
    single = deepcopy(scenario)
    single.home = drawn.home
    single.pushes, single.aim_spread = [drawn.push], 0.0
    single.duration = drawn.push.start + drawn.push.hold + scenario.touches.watched + 0.2
    single.system.cell.hand.finger_radius = drawn.finger_radius
    single.seed = scenario.own_seed(number)  # of the camera's noise
    return Trial(number, drawn, single)


def run_trial(trial: Trial, build: Build, options: RunOptions, label: str = "") -> TrialRun:
    """Run one random touch and judge it."""
    scenario, push = trial.scenario, trial.drawn.push
    setup = build(scenario, options.meshcat)
    run = Simulation(setup.diagram, label, options)
    seen = seen_by(run, setup, push.start + push.hold - 0.1)
    run.to(setup.duration)
    log, fast = run.log(setup.recorder), run.log(setup.fast)
    K_p = np.broadcast_to(scenario.system.pipeline.controller.K_p, 3)
    touch = judged_touch(setup.robot, trial.number, trial.drawn, log, fast, seen, K_p, scenario.touches.watched)
    return TrialRun(touch, setup, log)


def seen_by(run: Simulation, setup: ContactSetup, time: float) -> bool:
    """Run until a time (s), and return whether the camera then sees who touches the arm."""
    context, cell = run.to(time), setup.parts.cell
    truth = contact_truth(cell.contact_results.Eval(cell.plant.GetMyContextFromRoot(context)), cell)
    return is_seen(setup.parts, context, setup.robot, truth[3:6])


def run_random(
    scenario: Any,
    options: RunOptions,
    build: Build,
    figure: Callable[[ContactSetup, Log], Figure],
    replay: Callable[[ContactSetup, Log, Path], None],
    title: str,
) -> Outcome:
    """Run random touches and judge each; the replay shows the worst, signals and figure a touch alone or all."""
    numbers, touches = scenario.numbers, list[JudgedTouch]()

    def runs() -> Iterator[TrialRun]:
        for k, number in enumerate(numbers, 1):
            label = f"touch {k} of {len(numbers)}, {sum(touch.meets_all for touch in touches)} met all;"
            result = run_trial(trial_of(scenario, number), build, options, label)
            touches.append(result.touch)
            yield result

    worst = reduce(lambda worst, other: other if other.touch.worse_than(worst.touch) else worst, runs())
    setup, signals, log = worst.setup, worst.log, touch_log(touches)
    failed = failures(setup.robot, touches, scenario)
    if failed:
        say(failed)
    return Outcome(
        random_metrics(touches),
        signals if scenario.trial >= 0 else log,
        lambda: figure(setup, signals) if scenario.trial >= 0 else touches_figure(log, title),
        lambda path: replay(setup, signals, path),
        {"failures.txt": failed + "\n" if failed else ""},
    )
