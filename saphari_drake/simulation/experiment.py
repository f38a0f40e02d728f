"""The runner of experiments: one command line, one table a case, one set of output files, one exit status for all."""

from __future__ import annotations

import argparse
import math
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from saphari_drake.errors import ParameterError, SaphariError, UnknownNameError
from saphari_drake.simulation.files import atomic_path, write_text
from saphari_drake.simulation.log import Log
from saphari_drake.simulation.replay import start_meshcat
from saphari_drake.simulation.results import Metric, Outcome, table, write_outputs
from saphari_drake.simulation.scenario import checked, load_tree, merged, to_tree, with_assignments

__all__ = ["Experiment", "Log", "Metric", "Outcome", "RunOptions", "advance", "main"]

PASSED, MISSED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
CHUNK = 0.1  # simulated time between two looks at the clock (s)


@dataclass(frozen=True)
class RunOptions:
    """What a run is given beside its scenario.

    Attributes
    ----------
    meshcat : Meshcat, optional
        Live view to publish to.
    out : path, optional
        Folder of this case, if files are to be written.
    """

    meshcat: Meshcat | None = None
    out: Path | None = None

    @property
    def realtime_rate(self) -> float:
        """Rate to aim at: 1 with a live view, otherwise 0 (as fast as possible)."""
        return 0.0 if self.meshcat is None else 1.0


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
    accepts_model : bool
        Whether another robot may be given.
    """

    name: str
    summary: str
    cases: Mapping[str, str]
    scenario_for: Callable[[str], Any]
    run: Callable[[Any, RunOptions], Outcome]
    build_diagram: Callable[[Any], Diagram] | None = None
    accepts_model: bool = False


def advance(simulator: Simulator, duration: float, label: str = "") -> float:
    """Advance a simulator by `duration` (s), showing progress on stderr if that is a terminal.

    Returns
    -------
    float
        Wall time it took (s).
    """
    start, wall_start, shown = simulator.get_context().get_time(), time.perf_counter(), -math.inf
    terminal = sys.stderr.isatty()
    steps = max(1, math.ceil(duration / CHUNK - 1e-9))
    for step in range(1, steps + 1):
        simulator.AdvanceTo(start + duration * step / steps)
        wall = time.perf_counter() - wall_start
        if terminal and (wall - shown > 0.1 or step == steps):
            shown, done = wall, duration * step / steps
            rate = done / max(wall, 1e-9)
            print(f"\r{label} {done:.1f} s of {duration:g} s, {step / steps:4.0%}, {rate:.2f} × real time\x1b[K",
                  end="\n" if step == steps else "", file=sys.stderr, flush=True)  # fmt: skip
    return time.perf_counter() - wall_start


def main(experiment: Experiment, argv: Sequence[str] | None = None) -> int:
    """Run an experiment from the command line.

    Returns
    -------
    int
        0 if all bounds are met, 1 if some are missed, 2 for input that cannot be used (told in one line).
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        return _main(experiment, argv)
    except (SaphariError, OSError) as error:
        return _complain(experiment, error)
    except KeyboardInterrupt:
        print(f"\n{experiment.name}: interrupted", file=sys.stderr)
        return INTERRUPTED


def _main(experiment: Experiment, argv: Sequence[str] | None) -> int:
    options = _parser(experiment).parse_args(argv)
    if options.list_cases:
        width = max(len(case) for case in experiment.cases)
        print("\n".join(f"{case:<{width}}  {text}" for case, text in experiment.cases.items()))
        return PASSED
    scenarios = _scenarios(experiment, options)
    if options.graphviz is not None:
        _write_graph(experiment, scenarios[0], options.graphviz)
        return PASSED
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    meshcat = None
    if options.meshcat:
        meshcat = start_meshcat()
        print(f"Meshcat: {meshcat.web_url()}", flush=True)
    status = PASSED
    for scenario in scenarios:
        folder = None if options.out is None else options.out / scenario.case
        try:
            passed = _run_case(experiment, scenario, RunOptions(meshcat, folder))
            status = max(status, PASSED if passed else MISSED)
        except (SaphariError, OSError) as error:
            status = _complain(experiment, error, f"case {scenario.case}: ")
    if meshcat is not None and sys.stdin.isatty():
        input("Press Enter to close the view. ")
    return status


def _run_case(experiment: Experiment, scenario: Any, options: RunOptions) -> bool:
    """Run one case, print its table and write its files; return whether it passed."""
    tree = to_tree(scenario)
    outcome = experiment.run(scenario, options)
    word = "pass" if outcome.passed else "FAIL"
    print(f"\n{experiment.name} / {scenario.case}: {experiment.cases[scenario.case]}")
    print(f"{table(outcome.metrics)}\n{scenario.case}: {word}", flush=True)
    if options.out is not None:
        write_outputs(options.out, outcome, tree)
    return outcome.passed


def _scenarios(experiment: Experiment, options: argparse.Namespace) -> list[Any]:
    """Return the checked scenario of every case to run, before the first of them is run."""
    tree = {} if options.scenario is None else load_tree(options.scenario)
    cases = options.case or list(experiment.cases)
    if "case" in tree:
        if options.case not in (None, [tree["case"]]):
            raise ParameterError("--case", f"{options.scenario} is a scenario of case '{tree['case']}'")
        cases = [str(tree["case"])]
    for case in cases:
        if case not in experiment.cases:
            raise UnknownNameError("case", case, experiment.cases)
    given = {name: getattr(options, name) for name in ("seed", "duration") if getattr(options, name) is not None}
    if options.model is not None:
        if not experiment.accepts_model:
            raise ParameterError("--model", "this experiment runs with its own robot only")
        if not options.model.is_file():
            raise ParameterError("--model", f"no file '{options.model}'")
        given["robot"] = str(options.model.resolve())
    scenarios = []
    for case in dict.fromkeys(cases):
        scenario = merged(experiment.scenario_for(case), tree)
        scenario = with_assignments(merged(scenario, given), options.set)
        if scenario.case != case:
            raise ParameterError("case", "cannot be set; choose it with --case")
        if not (math.isfinite(scenario.duration) and scenario.duration > 0.0):
            raise ParameterError("duration", f"must be positive and finite, got {scenario.duration}")
        if scenario.seed < 0:
            raise ParameterError("seed", f"must not be negative, got {scenario.seed}")
        scenarios.append(checked(scenario))
    return scenarios


def _write_graph(experiment: Experiment, scenario: Any, path: Path) -> None:
    """Write the block diagram of a scenario as Graphviz text, or as an image if the suffix names one."""
    if experiment.build_diagram is None:
        raise ParameterError("--graphviz", "this experiment has no block diagram")
    text = experiment.build_diagram(scenario).GetGraphvizString()
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("svg", "png", "pdf"):
        write_text(path, text)
        return
    dot = shutil.which("dot")
    if dot is None:
        raise ParameterError("--graphviz", f"a .{kind} file needs the program 'dot' of Graphviz; .dot works without")
    with atomic_path(path) as temporary:
        subprocess.run([dot, f"-T{kind}", "-o", str(temporary)], input=text.encode(), check=True)


def _complain(experiment: Experiment, error: Exception, where: str = "") -> int:
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    print(f"{experiment.name}: error: {where}{' '.join(text.split())}", file=sys.stderr, flush=True)
    return BAD_INPUT


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise SaphariError(f"{message} (--help lists the options)")


def _parser(experiment: Experiment) -> argparse.ArgumentParser:
    script, first = f"python diagrams/{experiment.name}.py", next(iter(experiment.cases))
    parser = _Parser(
        prog=experiment.name,
        description=experiment.summary,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=f"""examples:
  {script} --list-cases
  {script} --case {first} --out runs
  {script} --case {first} --set seed=3 --set duration=2.5
  {script} --scenario runs/{first}/scenario.yaml

Every name in scenario.yaml can be set, nested ones with dots: --set controller.gain=20.
Order: the case's own values, then --scenario, then --seed, --duration and --model, then --set.
Exit status: 0 all bounds met, 1 some missed, 2 input that cannot be used. Timing figures (*_ms_*) never decide.""",
    )
    add = parser.add_argument
    add("--case", action="append", metavar="NAME", help="case to run; may be repeated (default: all)")
    add("--list-cases", action="store_true", help="list the cases and stop")
    add("--seed", type=int, metavar="N", help="seed of everything random")
    add("--duration", type=float, metavar="S", help="simulated time (s)")
    add("--set", action="append", default=[], metavar="PATH=VALUE", help="set a parameter by its dotted name")
    add("--scenario", type=Path, metavar="FILE.yaml", help="parameters, all or some; a case named there is run")
    model_help = "URDF or SDF of another robot" if experiment.accepts_model else "not accepted by this experiment"
    add("--model", type=Path, metavar="FILE", help=model_help)
    add("--out", type=Path, metavar="DIR", help="write metrics, log, figure, replay and scenario to DIR/CASE")
    add("--meshcat", action="store_true", help="live view in a browser; prints its address")
    add("--graphviz", type=Path, metavar="FILE", help="write the block diagram (.dot, .svg, .png, .pdf) and stop")
    return parser
