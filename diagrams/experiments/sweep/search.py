"""The worst case of a metric over what varies, searched by CMA-ES (Hansen, The CMA Evolution Strategy, 2016)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from experiments.sweep.plan import Plan, value_at
from experiments.sweep.rows import Journal
from experiments.sweep.worker import Row, Task
from saphari_drake.errors import ParameterError, SaphariError, UnknownNameError

STEP = 0.3  # first standard deviation, of the range of each parameter
POOR = 1e9  # cost of a trial without a value

Run = Callable[[Iterable[Task]], Iterator[Row]]


def search(
    plan: Plan, metric: str, trials: int, number: int, journal: Journal, run: Run, tell: Callable[[Row], None]
) -> None:
    """Search for the worst value of a metric; all rows go to the journal, and those that are there are not run again.

    Worse is larger, or smaller where the metric has a lower bound alone.

    Parameters
    ----------
    plan : Plan
    metric : str
    trials : int
        Evaluations, at most.
    number : int
        The trial of which the rest of the scenario is.
    journal : Journal
    run : callable
        Runs tasks and yields their rows.
    tell : callable
        Called with each new row.

    Raises
    ------
    UnknownNameError
        If the trials have no such metric.
    """
    if not plan.vary:
        raise ParameterError("--search", "needs --vary FILE.yaml: over what to search")
    names = list(plan.vary)
    known = {row.row: row for row in journal.rows()}
    strategy = _strategy(len(names), trials, plan.seed or 0)
    done = 0
    while done < trials and not strategy.stop():
        points = strategy.ask()
        tasks = [
            Task(done + k, number, {name: value_at(plan.vary[name], x) for name, x in zip(names, point)})
            for k, point in enumerate(points)
        ]
        for row in run(task for task in tasks if task.row not in known):
            journal.add(row)
            known[row.row] = row
            tell(row)
        rows = [known[task.row] for task in tasks]
        _require(metric, rows)
        strategy.tell(points, [cost(row, metric) for row in rows])
        done += len(points)


def cost(row: Row, metric: str) -> float:
    """Return what the search makes small."""
    value = row.values.get(metric)
    if value is None or not math.isfinite(value):
        return POOR
    low, high = row.bounds[metric]
    return value if math.isfinite(low) and not math.isfinite(high) else -value


def _require(metric: str, rows: list[Row]) -> None:
    names = {name for row in rows for name in row.bounds if name in row.values}
    if names and metric not in names:
        raise UnknownNameError("metric", metric, sorted(names))


def _strategy(size: int, trials: int, seed: int) -> Any:
    try:
        import cma
    except ImportError as error:
        raise SaphariError("--search needs the extra sweep: pip install 'saphari_drake[sweep]'") from error
    if size < 2:
        raise ParameterError("--search", "needs two parameters that vary, at least")
    options = {"bounds": [0.0, 1.0], "seed": seed + 1, "maxfevals": trials, "verbose": -9}
    return cma.CMAEvolutionStrategy(size * [0.5], STEP, options)
