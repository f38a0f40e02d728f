"""Runs trials, one after the other: called in place, or as a process that reads tasks and writes rows, a line each."""

from __future__ import annotations

import contextlib
import io
import json
import resource
import sys
import time
from typing import Any, NamedTuple

from experiments.sweep.plan import Plan, find_experiment, plan_of, scenario_of
from saphari_drake.errors import SaphariError
from saphari_drake.simulation.runner.results import TIMING, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions

MEGABYTE = 1024.0  # of what Linux counts in kB


class Task(NamedTuple):
    """One trial to run: its number in the table, the one that seeds it, and what varies."""

    row: int
    number: int
    values: dict[str, Any]


class Row(NamedTuple):
    """What became of it; `values` are the same wherever it ran, `times` are not."""

    row: int
    values: dict[str, Any]
    times: dict[str, float]
    bounds: dict[str, list[float]]


def run_task(plan: Plan, task: Task) -> Row:
    """Run one trial; what it prints is dropped, and an error of it is its result."""
    start, experiment = time.perf_counter(), find_experiment(plan.script)
    values: dict[str, Any] = {"trial": task.number, **task.values}
    times: dict[str, float] = {}
    bounds: dict[str, list[float]] = {}
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            outcome = experiment.outcome(scenario_of(experiment, plan, task.number, task.values), RunOptions())
        values |= {"met": met(outcome), "error": ""}
        for metric in outcome.metrics:
            (times if TIMING.search(metric.name) else values)[metric.name] = metric.value
            bounds[metric.name] = [metric.low, metric.high]
    except (SaphariError, RuntimeError, ValueError, ArithmeticError, SystemExit) as error:  # Drake leaves by the last
        values |= {"met": False, "error": " ".join(f"{type(error).__name__}: {error}".split())}
    times |= {"seconds": time.perf_counter() - start}
    times |= {"memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MEGABYTE}
    return Row(task.row, values, times, bounds)


def met(outcome: Outcome) -> bool:
    """Whether a trial meets all it has to: what the case itself says of its trials, else the verdict."""
    own = [metric.value for metric in outcome.metrics if metric.name == "meets_all_share"]
    return own[0] == 1.0 if own else outcome.passed


def main() -> None:
    """Read a plan and then tasks from stdin; answer each with a row on stdout."""
    answers, sys.stdout = sys.stdout, sys.stderr
    plan = plan_of(json.loads(sys.stdin.readline()))
    for line in sys.stdin:
        print(json.dumps(run_task(plan, Task(*json.loads(line)))), file=answers, flush=True)


if __name__ == "__main__":
    main()
