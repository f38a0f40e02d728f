"""When a fault began and how soon it was answered: metrics of every run with faults."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from saphari_drake.simulation.faults.watch import Answer
from saphari_drake.simulation.runner.results import Metric


def fault_metrics(scenario: Any, answers: Iterable[Answer]) -> list[Metric]:
    """Return start and reaction of the faults of a `PlantScenario`; `answers`: what became of them in each run.

    The reaction counts from the first effect above the noise. A fault that no system answers within the run is silent,
    and its reaction is infinite. Neither decides a verdict: not every fault needs a safe state.
    """
    start = min(scenario.truth(1.0).faults.values())
    reactions = np.array([answer.reaction for answer in answers], dtype=float)
    silent = float(np.sum(~np.isfinite(reactions)))
    longest = float(reactions.max()) if reactions.size else np.inf
    return [
        Metric("fault_time_s", start, "s"),
        Metric("fault_reaction_s", longest, "s", high=0.1, decides=False),
        Metric("silent_faults", silent if reactions.size else 1.0, "1", high=0.0, decides=False),
    ]
