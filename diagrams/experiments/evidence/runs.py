"""Runs of experiment scripts, each a process of its own on one thread, some at a time."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Job:
    """One case to run, CASE or CASE/realistic; with `seed` None the script takes its own."""

    script: str
    case: str
    seed: int | None = None
    label: str = ""  # tells runs of one case and seed apart
    options: tuple[str, ...] = ()  # more of the command line

    @property
    def name(self) -> str:
        """Name of the run, as it is shown."""
        more = f" {self.label}" if self.label else ""
        return f"{self.script}/{self.case}{more}" + ("" if self.seed is None else f" seed {self.seed}")


@dataclass(frozen=True)
class Run:
    """What became of a job.

    Attributes
    ----------
    job : Job
    status : int
        Exit status of the process.
    seconds : float
        Wall time (s).
    document : dict
        Content of metrics.json; empty if there is none.
    complaint : str
        Last line on stderr.
    """

    job: Job
    status: int
    seconds: float
    document: dict[str, Any] = field(default_factory=dict)
    complaint: str = ""

    @property
    def complete(self) -> bool:
        """Whether the run came to its end, with its bounds met (0) or not (1), and has its metrics."""
        return self.status in (0, 1) and bool(self.document)


def run_job(job: Job, path: Path, out: Path, keep: bool = True) -> Run:
    """Run one case of the script at `path`, which writes its files below `out`; read and, if asked, remove them."""
    folder = out / job.script / ("default" if job.seed is None else f"seed_{job.seed}")
    case, _, plant = job.case.partition("/")
    folder /= plant  # nothing: the ideal one
    folder /= job.label
    command = [sys.executable, str(path), "--case", case, "--out", str(folder), *job.options]
    command += ["--plant", plant] if plant else []
    command += [] if job.seed is None else ["--seed", str(job.seed)]
    environment = {**os.environ, **dict.fromkeys(THREADS, "1")}
    metrics = folder / case / "metrics.json"
    metrics.unlink(missing_ok=True)
    start = time.perf_counter()
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", env=environment
    )
    seconds = time.perf_counter() - start
    document = json.loads(metrics.read_text(encoding="utf-8")) if metrics.is_file() else {}
    if not keep:
        shutil.rmtree(folder / case, ignore_errors=True)
    return Run(job, done.returncode, seconds, document, (done.stderr.strip().splitlines() or [""])[-1])


def run_all(
    jobs: Sequence[Job], paths: Mapping[str, Path], out: Path, workers: int = 2, keep: bool = True
) -> Iterator[Run]:
    """Run jobs, `workers` at a time in their order, and yield each run as it ends."""
    pool = ThreadPoolExecutor(workers)
    try:
        for future in as_completed([pool.submit(run_job, job, paths[job.script], out, keep) for job in jobs]):
            yield future.result()
    finally:
        pool.shutdown(cancel_futures=True)
