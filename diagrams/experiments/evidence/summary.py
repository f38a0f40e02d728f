"""What a case's runs over seeds come to: value, worst, median, spread, and how far the next run may be off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.evidence.machine import machine
from experiments.evidence.runs import Run
from saphari_drake.simulation.runner import results

SAME = 1e-9  # of the value; seeds whose values differ by less change nothing
BOUNDED_FLOOR, BOUND_FLOOR, OPEN_FLOOR, LEAST = 0.05, 0.02, 0.10, 1e-6
ABOUT = {"unit": "units", "decides": "decides", "reported": "reported"}
Bound = tuple[float | None, float | None]


def missed_by(value: float | None, bound: Bound) -> float:
    """Return how far a value is beyond its nearer bound, negative within both; infinite for no value."""
    if value is None:
        return math.inf
    low, high = bound
    sides = [-math.inf if low is None else low - value, -math.inf if high is None else value - high]
    return max(sides)


def bound_text(bound: Bound) -> str:
    """Return a bound as text: "≤ 0.1", "≥ 0", "1 … 2", or "–" for none."""
    low, high = bound
    return results.bound_text(-math.inf if low is None else low, math.inf if high is None else high)


def is_bounded(bound: Bound) -> bool:
    """Whether there is a bound to miss."""
    return any(side is not None for side in bound)


def allowed_difference(value: float | None, spread: float, bound: Bound) -> float:
    """Return how far a run may be off its recorded value.

    That is the spread over seeds, and at least what rounding on another processor may do in loops with contact: 5 % of
    the value or 2 % of the bound; without a bound 10 % of the value. A value of zero may be off by a millionth.
    """
    side = max((abs(side) for side in bound if side is not None), default=0.0)
    share = BOUNDED_FLOOR if is_bounded(bound) else OPEN_FLOOR
    return max(spread, share * abs(value or 0.0), BOUND_FLOOR * side) or LEAST


def is_same(values: Mapping[int, float | None]) -> bool | None:
    """Whether every seed gives the same value; None if there is one seed alone."""
    if len(values) < 2:
        return None
    finite = [value for value in values.values() if value is not None]
    if len(finite) < len(values):
        return not finite
    return max(finite) - min(finite) <= SAME * max(1.0, abs(finite[0]))


def summarize_metric(values: Mapping[int, float | None], default_seed: int, bounds: Mapping[int, Bound]) -> dict:
    """Return the figures of one metric.

    Parameters
    ----------
    values : mapping from int to float or None
        Value of each seed; None where there is none or it is not finite.
    default_seed : int
    bounds : mapping from int to (low, high)
        Bounds in each seed's run, None where there is none; they may follow from the run.

    Returns
    -------
    dict
        `value` and `bound` are those of the default seed; `worst` is the value that is farthest towards or beyond its
        bound (None without a bound, and if a seed has no value); `missed` lists the seeds beyond their bound; `same`
        says whether a seed changes nothing (None if only one was run).
    """
    finite = [value for value in values.values() if value is not None]
    bound = bounds.get(default_seed, next(iter(bounds.values())))
    bounded = any(is_bounded(each) for each in bounds.values())
    beyond = {seed: missed_by(value, bounds.get(seed, bound)) for seed, value in values.items()}
    spread = max(finite) - min(finite) if finite else 0.0
    value = values.get(default_seed)
    return {
        "value": value,
        "worst": values[max(beyond, key=lambda seed: beyond[seed])] if bounded else None,
        "median": float(np.median(finite)) if finite else None,
        "min": min(finite, default=None),
        "max": max(finite, default=None),
        "spread": spread,
        "allowed": allowed_difference(value, spread, bound),
        "bound": list(bound),
        "missed": [seed for seed, by in beyond.items() if bounded and by > 0.0],
        "same": is_same(values),
    }


def summarize_case(runs: Sequence[Run], default_seed: int, seedless: bool = False) -> dict[str, Any]:
    """Return what the file of results says of one case, from its runs, the default seed's among them.

    With `seedless`, the case says that a seed changes nothing, and one run is all there is to know.
    """
    by_seed = {run.document["scenario"]["seed"]: run for run in sorted(runs, key=lambda run: _seed(run))}
    first = by_seed[default_seed].document
    documents = [first, *(run.document for run in by_seed.values())]
    names = list(dict.fromkeys(name for document in documents for name in document["metrics"]))
    metrics, timings = {}, {}
    for name in names:
        values = {seed: run.document["metrics"].get(name) for seed, run in by_seed.items()}
        bounds = {
            seed: tuple(run.document["bounds"][name]) for seed, run in by_seed.items() if name in run.document["bounds"]
        }
        source = next(document for document in documents if name in document["metrics"])
        about = {key: source[table][name] for key, table in ABOUT.items()}
        if results.TIMING.search(name):
            timings[name] = {"value": first["metrics"].get(name), "bound": list(next(iter(bounds.values()))), **about}
        else:
            figures = summarize_metric(values, default_seed, bounds)
            metrics[name] = {**figures, "same": True if seedless else figures["same"], **about}
    return {
        "default_seed": default_seed,
        "seeds": list(by_seed),
        "verdicts": {str(seed): run.document["verdict"] for seed, run in by_seed.items()},
        "seconds": round(float(np.mean([run.seconds for run in runs]))),
        "plant": first["scenario"].get("plant", "ideal"),
        "machine": machine(),
        "versions": first["versions"],
        "metrics": metrics,
        "timings": timings,
    }


def _seed(run: Run) -> int:
    return run.document["scenario"]["seed"]
