"""The shortest run of a scenario that still gives its figure, for --quick."""

from __future__ import annotations

from typing import Any


def shorten(scenario: Any, duration: float = 2.0, trials: int = 1) -> None:
    """Let a scenario last no longer than `duration` (s), and have no more trials, if it has any."""
    scenario.duration = min(scenario.duration, duration)
    if hasattr(scenario, "trials"):
        scenario.trials = min(scenario.trials, trials)
