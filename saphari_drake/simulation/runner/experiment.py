"""The runner of experiments: one command line, one table a case, one set of output files, one exit status for all."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Diagram

from saphari_drake.errors import ParameterError, SaphariError, UnknownNameError
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.registry import require_faults
from saphari_drake.simulation.record.files import own_folder
from saphari_drake.simulation.record.frames import FrameKeeper
from saphari_drake.simulation.runner.command_line import complain, parser, say
from saphari_drake.simulation.runner.faults import fault_metrics
from saphari_drake.simulation.runner.graph import write_graph
from saphari_drake.simulation.runner.interrupt import STOP, InterruptedRunError
from saphari_drake.simulation.runner.other_robot import adapted, robot_named
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Outcome, judged_so_far, prepare_folder, table, write_outputs
from saphari_drake.simulation.runner.scenario import checked, load_tree, merged, to_tree, with_assignments
from saphari_drake.simulation.runner.simulation import RunOptions
from saphari_drake.simulation.view.mcap import require_mcap
from saphari_drake.simulation.view.replay import start_meshcat

PASSED, MISSED, BAD_INPUT = 0, 1, 2
LEAST_DURATION = 0.02  # s; some control cycles of every experiment


@dataclass(frozen=True)
class Experiment:
    """One experiment and its cases.

    Every scenario is a dataclass with at least `case`, `seed`, `duration` (s) and `robot` (catalog name or path).

    Attributes
    ----------
    name, summary : str
    cases : mapping from str to str
        Each case with a description in one line.
    scenario_for : callable
        Returns the default scenario of a case.
    run : callable
        Runs a scenario and returns its outcome.
    build_diagram : callable, optional
        Returns the diagram of a scenario, to be drawn.
    adapt : callable, optional
        Fits a case's scenario to another robot, which may be given then; it raises `ModelError` for one that cannot
        do it. What the scenario file, --set and the other options name comes after.
    own_robot : frozenset of str
        Cases that are of their own robot, whatever `adapt` does for the others.
    seedless : frozenset of str
        Cases in which a seed changes nothing: the worst of several seeds says no more than one.
    parts : callable
        Returns what of a case a fault can act on, out of `saphari_drake.simulation.faults.registry.PARTS`.
    quick : callable
        Shortens a scenario to the least that gives its figure, for --quick; whatever else is given comes after.
    """

    name: str
    summary: str
    cases: Mapping[str, str]
    scenario_for: Callable[[str], Any]
    run: Callable[[Any, RunOptions], Outcome]
    build_diagram: Callable[[Any], Diagram] | None = None
    adapt: Callable[[Any, RobotModel], None] | None = None
    own_robot: frozenset[str] = frozenset()
    seedless: frozenset[str] = frozenset()
    parts: Callable[[str], Collection[str]] = lambda case: ()
    quick: Callable[[Any], None] = shorten

    def __post_init__(self) -> None:
        for case in self.seedless | self.own_robot:
            if case not in self.cases:
                raise UnknownNameError("case", case, self.cases)

    @property
    def others(self) -> list[str]:
        """The cases that another robot can be given to."""
        return [case for case in self.cases if case not in self.own_robot]

    def described(self, case: str) -> str:
        """Return what a case is, and whether a seed changes nothing in it."""
        return self.cases[case] + ("; a seed changes nothing" if case in self.seedless else "")

    def outcome(self, scenario: Any, options: RunOptions) -> Outcome:
        """Run a scenario; with faults, their metrics come on top."""
        result = self.run(scenario, options)
        if not getattr(scenario, "faults", []):
            return result
        return replace(result, metrics=[*result.metrics, *fault_metrics(scenario, options.answered.values())])

    def seed_matters(self, scenario: Any) -> bool:
        """Return whether a seed changes what a run of the scenario gives; it does for every plant that is not ideal."""
        return scenario.case not in self.seedless or (
            getattr(scenario, "plant", "ideal") != "ideal" or bool(getattr(scenario, "faults", []))
        )


def main(experiment: Experiment, argv: Sequence[str] | None = None) -> int:
    """Run an experiment from the command line.

    Returns
    -------
    int
        0 if all bounds are met, 1 if some are missed, 2 for input that cannot be used (told in one line), and 128 more
        than the number of a signal that has ended it.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        with STOP.heard():
            return _main(experiment, argv)
    except (SaphariError, OSError) as error:
        complain(experiment.name, error)
        return BAD_INPUT
    except (KeyboardInterrupt, Exception) as error:  # a compiler that is interrupted fails in its own way
        if not (STOP.signal or isinstance(error, KeyboardInterrupt)):
            raise
        print(f"\n{experiment.name}: interrupted", file=sys.stderr)
        return STOP.status


def _main(experiment: Experiment, argv: Sequence[str] | None) -> int:
    options = parser(experiment.name, experiment.summary, experiment.cases, experiment.adapt is not None).parse_args(
        argv
    )
    if options.list_cases:
        width = max(len(case) for case in experiment.cases)
        say("\n".join(f"{case:<{width}}  {experiment.described(case)}" for case in experiment.cases))
        return PASSED
    scenarios = scenarios_of(experiment, options)
    if options.graphviz is not None:
        write_graph(experiment.build_diagram, scenarios[0], options.graphviz)
        return PASSED
    if options.also and options.out is None:
        raise ParameterError(f"--{options.also[0]}", "needs --out, the folder to write to")
    if "mcap" in options.also:
        require_mcap()
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    meshcat = None
    if options.meshcat:
        meshcat = start_meshcat()
        say(f"Meshcat: {meshcat.web_url()}")
    status = PASSED
    for scenario in scenarios:
        folder = None if options.out is None else options.out / scenario.case
        try:
            with contextlib.nullcontext() if folder is None else own_folder(folder):
                run_options = RunOptions(meshcat, frames=FrameKeeper() if "mcap" in options.also else None)
                passed = _run_case(experiment, scenario, run_options, folder, options.also)
            status = max(status, PASSED if passed else MISSED)
        except (SaphariError, OSError, MemoryError) as error:
            complain(experiment.name, error, f"case {scenario.case}: ")
            status = BAD_INPUT
        except InterruptedRunError as stop:
            kept = ""
            if folder is not None:
                stop.log.save(folder / "log.npz")
                kept = f"; what was recorded so far is in {folder / 'log.npz'}"
            print(f"{experiment.name}: case {scenario.case}: {stop} of {scenario.duration:g} s{kept}", file=sys.stderr)
            return STOP.status
    if meshcat is not None and sys.stdin.isatty():
        with contextlib.suppress(EOFError):
            input("Press Enter to close the view. ")
    return status


def _run_case(experiment: Experiment, scenario: Any, options: RunOptions, folder: Path | None, also: list[str]) -> bool:
    """Run one case, print its table and write its files; return whether it passed."""
    if folder is not None:
        prepare_folder(folder, scenario)
    tree = to_tree(scenario)
    shortened = scenario.duration < experiment.scenario_for(scenario.case).duration
    outcome = judged_so_far(experiment.outcome(scenario, options), shortened)
    word = "pass" if outcome.passed else "FAIL"
    heading = f"{experiment.name} / {scenario.case}: {experiment.described(scenario.case)}"
    if getattr(scenario, "plant", "ideal") != "ideal":
        heading += f"\nplant: {scenario.plant}"
    if getattr(scenario, "faults", []):
        heading += f"\nfaults: {', '.join(scenario.faults)}"
    word += f" (not judged: {outcome.note})" if outcome.note else ""
    say(f"\n{heading}\n{table(outcome.metrics)}\n{scenario.case}: {word}")
    if folder is not None:
        frames = () if options.frames is None else options.frames.frames
        write_outputs(folder, outcome, tree, experiment.seed_matters(scenario), also, frames)
    return outcome.passed


def scenarios_of(experiment: Experiment, options: argparse.Namespace) -> list[Any]:
    """Return the checked scenario of every case to run, before the first of them is run."""
    tree = {} if options.scenario is None else load_tree(options.scenario)
    cases = options.case or (list(experiment.cases) if options.model is None else experiment.others)
    if "case" in tree:
        if options.case not in (None, [tree["case"]]):
            raise ParameterError("--case", f"{options.scenario} is a scenario of case '{tree['case']}'")
        cases = [str(tree["case"])]
    for case in cases:
        if case not in experiment.cases:
            raise UnknownNameError("case", case, experiment.cases)
    given = {
        name: getattr(options, name) for name in ("seed", "duration", "plant") if getattr(options, name) is not None
    }
    if options.model is not None:
        for case in set(cases) & experiment.own_robot:
            raise ParameterError(
                "--model", f"case {case} is of its own robot; another one takes {', '.join(experiment.others)}"
            )
        if experiment.adapt is None:
            raise ParameterError("--model", "this experiment runs with its own robot only")
        if not options.model.is_file():
            raise ParameterError("--model", f"no file '{options.model}'")
        given["robot"] = str(options.model.resolve())
    scenarios = []
    for case in dict.fromkeys(cases):
        known = [text for text in options.set if text.startswith("model.")]  # of the robot, which it takes to load it
        scenario = with_assignments(experiment.scenario_for(case), known)
        scenario = adapted(experiment, scenario, robot_named(given, options.set, tree))
        if options.quick:
            experiment.quick(scenario)
        scenario = with_assignments(merged(merged(scenario, tree), given), options.set)
        if scenario.case != case:
            raise ParameterError("case", "cannot be set; choose it with --case")
        if not LEAST_DURATION <= scenario.duration < math.inf:
            raise ParameterError("duration", f"must be finite and at least {LEAST_DURATION} s, got {scenario.duration}")
        if scenario.seed < 0:
            raise ParameterError("seed", f"must not be negative, got {scenario.seed}")
        require_faults(getattr(scenario, "faults", []), experiment.parts(case))
        scenarios.append(checked(scenario))
    return scenarios
