"""What sweep.py does with its options."""

from __future__ import annotations

import argparse
import json
import sys
import time
from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from experiments.evidence.progress import minutes
from experiments.sweep import arrays_command
from experiments.sweep.plan import Plan, find_experiment, plan_of, read_vary, scenario_of
from experiments.sweep.pool import RECYCLE, run_local, run_ray
from experiments.sweep.rows import PLAN, Journal, write_tables
from experiments.sweep.search import search
from experiments.sweep.worker import Row, Task
from saphari_drake.errors import ParameterError, SaphariError, UnknownNameError
from saphari_drake.simulation.record.files import write_text
from saphari_drake.simulation.runner.command_line import complain, say
from saphari_drake.simulation.runner.results import prepare_folder, table, write_outputs
from saphari_drake.simulation.runner.scenario import load_tree, to_tree
from saphari_drake.simulation.runner.simulation import RunOptions

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
SHOWN, EVERY = 20, 20.0  # failing trials that are listed; s, between two lines of progress

EPILOG = """examples:
  python diagrams/sweep.py contact_force --case random --trials 1000 --out runs/force
  python diagrams/sweep.py contact_force --case random --out runs/force --replay 17
  python diagrams/sweep.py null_space_ball --case momentum --trials 400 --vary vary.yaml --search peak_force_N --out b
  python diagrams/sweep.py nmpc_manipulator --case random --trials 1000 --ray local --out runs/nmpc
  python diagrams/sweep.py arrays --trials 300000 --out runs/arrays     envelope, stop check, NMPC; no diagram

Trial k of a case of random trials is the one that --set trial=k runs; of other cases it is the seed plus k. FILE.yaml
says what else varies, a parameter a line: "pushes[0].force: {uniform: [10, 40]}"; also log_uniform, and choice.
DIR gets trials.parquet, the same rows wherever they ran, times.parquet, summary.json and failures.txt. A sweep that
was interrupted goes on where it was, and grows with larger --trials.
Exit status: 0 done, 1 some trials ended with an error, 2 input that cannot be used."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise SaphariError(f"{message} (--help lists the options)")


def parse(argv: Sequence[str] | None) -> Namespace:
    """Return the options."""
    parser = _Parser(
        prog="sweep",
        description="Run many trials of an experiment, search for its worst case, or replay a trial.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=EPILOG,
    )
    add = parser.add_argument
    add("experiment", metavar="EXPERIMENT", help="name of a script beside this one")
    add("--case", default="random", metavar="NAME", help="its case (default: random)")
    add("--trials", type=int, default=100, metavar="N", help="how many (default: 100)")
    add("--seed", type=int, metavar="S", help="seed of the sweep")
    add("--set", action="append", default=[], metavar="PATH=VALUE", help="set a parameter of all trials")
    add("--scenario", type=Path, metavar="FILE.yaml", help="parameters of all trials, all or some")
    add("--vary", type=Path, metavar="FILE.yaml", help="what varies from trial to trial")
    add("--search", metavar="METRIC", help="search for its worst value over what varies, by CMA-ES")
    add("--trial", type=int, default=0, metavar="K", help="with --search: the trial of which the rest is (default: 0)")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, default=2, metavar="K", help="processes of this machine (default: 2)")
    where.add_argument("--ray", metavar="ADDRESS", help='a Ray cluster, or "local" for one of this machine')
    add("--recycle", type=int, default=RECYCLE, metavar="R", help=f"trials of a process (default: {RECYCLE})")
    add("--out", type=Path, required=True, metavar="DIR", help="where the rows go")
    add("--replay", type=int, metavar="ROW", help="run one row of DIR again and write its files to DIR/replays/ROW")
    options = parser.parse_args(argv)
    for name in ("trials", "workers", "recycle"):
        if getattr(options, name) < 1:
            raise ParameterError(f"--{name}", f"must be at least 1, got {getattr(options, name)}")
    return options


def main(argv: Sequence[str] | None) -> int:
    """Do what the command line says and return the exit status."""
    given = list(sys.argv[1:] if argv is None else argv)
    try:
        if given[:1] == ["arrays"]:
            return arrays_command.main(given[1:])
        options = parse(given)
        return _replay(options) if options.replay is not None else _sweep(options)
    except (SaphariError, OSError) as error:
        complain("sweep", error)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("\nsweep: interrupted; the same command goes on", file=sys.stderr)
        return INTERRUPTED


def _sweep(options: Namespace) -> int:
    plan = _plan(options)
    experiment = find_experiment(plan.script)
    scenario_of(experiment, plan, 0, plan.drawn(0))  # tells what cannot be used, before anything runs
    journal, progress = Journal(options.out, plan), Progress(options.trials)
    progress.begin(journal)

    def run(tasks: Iterable[Task]) -> Iterator[Row]:
        if options.ray:
            return run_ray(plan, tasks, options.ray, options.workers, options.recycle)
        return run_local(plan, tasks, options.workers, options.recycle)

    if options.search:
        search(plan, options.search, options.trials, options.trial, journal, run, progress.tell)
    else:
        numbers = [number for number in range(options.trials) if number not in journal.done]
        for row in run(Task(number, number, plan.drawn(number)) for number in numbers):
            journal.add(row)
            progress.tell(row)
    summary = write_tables(journal)
    say(told(summary, options.search))
    return FAILED if summary["errors"] else DONE


def _plan(options: Namespace) -> Plan:
    return Plan(
        options.experiment,
        options.case,
        options.seed,
        tuple(options.set),
        {} if options.scenario is None else load_tree(options.scenario),
        {} if options.vary is None else read_vary(options.vary),
    )


class Progress:
    """Says from time to time how many trials are done."""

    def __init__(self, trials: int) -> None:
        self._trials, self._done, self._met, self._fresh = trials, 0, 0, 0
        self._start = self._said = time.perf_counter()

    def begin(self, journal: Journal) -> None:
        """Count what is there already."""
        self._done, self._met = len(journal.done), sum(bool(row["met"]) for row in journal.done.values())
        if self._done:
            say(f"{self._done} trials are there already")

    def tell(self, row: Row) -> None:
        """Count a row."""
        self._done, self._fresh, self._met = self._done + 1, self._fresh + 1, self._met + bool(row.values["met"])
        now = time.perf_counter()
        if now - self._said > EVERY:
            self._said = now
            left = (now - self._start) / self._fresh * max(self._trials - self._done, 0)
            say(f"[{self._done}/{self._trials}] {self._met} met all; about {minutes(left)} left")


def told(summary: dict[str, Any], metric: str | None = None) -> str:
    """Return a summary as text."""
    rate, low, high = summary["rate"]
    plan = summary["plan"]
    lines = [
        f"{plan['script']} / {plan['case']}: {summary['met']} of {summary['trials']} trials met all they have to: "
        f"{rate:.1%}, 95 % interval {low:.1%} … {high:.1%}; {summary['errors']} errors",
        f"memory of the workers: {summary['memory_MB'][0]:.0f} MB at first, {summary['memory_MB'][1]:.0f} MB at last",
        f"{'metric':<34}{'median':>12}{'95 %':>12}{'worst':>12}  in trial",
    ]
    for name, found in summary["metrics"].items():
        middle, far = found["quantiles"][10], found["quantiles"][19]
        mark = "  <- searched" if name == metric else ""
        lines.append(f"{name:<34}{middle:>12.4g}{far:>12.4g}{found['worst']:>12.4g}  {found['worst_trial']}{mark}")
    failing = summary["failing"]
    if failing:
        more = f" and {len(failing) - SHOWN} more" if len(failing) > SHOWN else ""
        lines.append(f"failing (--replay): {', '.join(map(str, failing[:SHOWN]))}{more}")
    return "\n".join(lines)


def _replay(options: Namespace) -> int:
    """Run one row again, as it was, and write its files."""
    if not (options.out / PLAN).is_file():
        raise ParameterError("--replay", f"{options.out} holds no sweep")
    plan = plan_of(json.loads((options.out / PLAN).read_text(encoding="utf-8")))
    if plan.script != options.experiment:
        raise ParameterError("--replay", f"{options.out} is a sweep of {plan.script}")
    rows = Journal(options.out, plan).done
    if options.replay not in rows:
        raise UnknownNameError("row", str(options.replay), [f"0 … {len(rows) - 1}"])
    row, experiment = rows[options.replay], find_experiment(plan.script)
    scenario = scenario_of(experiment, plan, row["trial"], {name: row[name] for name in plan.vary})
    folder = options.out / "replays" / str(options.replay)
    folder.mkdir(parents=True, exist_ok=True)
    prepare_folder(folder, scenario)
    outcome = experiment.outcome(scenario, RunOptions())
    say(table(outcome.metrics))
    write_outputs(folder, outcome, to_tree(scenario))
    moved = [m.name for m in outcome.metrics if m.name in row and m.value != row[m.name] and m.value == m.value]
    write_text(folder / "row.json", json.dumps(row, indent=2) + "\n")
    say(f"{folder}: {'as in the sweep' if not moved else 'other than in the sweep: ' + ', '.join(moved)}")
    return FAILED if moved else DONE
