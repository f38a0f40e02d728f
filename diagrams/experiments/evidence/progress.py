"""What is done, how it ended and how long the rest will take, a line a run."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from experiments.evidence.runs import Job, Run

WORDS = {0: "pass", 1: "FAIL"}


class Progress:
    """Counts runs; times of earlier runs (s), by script and case, tell how long those to come may take."""

    def __init__(self, jobs: Sequence[Job], seconds: Mapping[tuple[str, str], float], workers: int) -> None:
        self.left, self.total, self.workers = list(jobs), len(jobs), workers
        self.seconds = seconds
        self.done: list[float] = []
        self.start = time.perf_counter()

    def line(self, run: Run) -> str:
        """Note a run that ended and return a line about it."""
        self.left.remove(run.job)
        self.done.append(run.seconds)
        word = WORDS.get(run.status, f"exit status {run.status}")
        head = f"[{self.total - len(self.left)}/{self.total}] {run.job.name}: {word}, {run.seconds:.0f} s"
        return f"{head}; about {minutes(self.time_left())} left" if self.left else head

    def time_left(self) -> float:
        """Return the time (s) that the runs to come may take; unknown ones are taken for average."""
        mean = sum(self.done) / max(1, len(self.done))
        known = [self.seconds.get((job.script, job.case), mean) for job in self.left]
        return sum(known) / min(self.workers, max(1, len(known)))

    @property
    def elapsed(self) -> float:
        """Wall time since the start (s)."""
        return time.perf_counter() - self.start


def minutes(seconds: float) -> str:
    """Return a time as "12 s" or "3.5 min"."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.1f} min"
