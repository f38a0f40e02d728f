"""Run the gate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path

from experiments.evidence.discovery import Script, select
from experiments.evidence.gate import MAIN_SCRIPT, failures, gate_jobs, seed_of_the_day
from experiments.evidence.progress import Progress, minutes
from experiments.evidence.recording import Say, seconds_of
from experiments.evidence.results_file import read_results
from experiments.evidence.runs import run_all


def check(
    scripts: Mapping[str, Script],
    only: Sequence[str],
    results_path: Path,
    out: Path,
    workers: int,
    keep: bool,
    say: Say,
    main: str = MAIN_SCRIPT,
) -> list[str]:
    """Run every case with its default seed, and the main script with the seed of the day; return what fails."""
    results, pairs, seed = read_results(results_path), select(scripts, only), seed_of_the_day(date.today())
    say(f"seed of the day: {seed}")
    jobs = gate_jobs(pairs, seed, results, main)
    progress = Progress(jobs, seconds_of(results), workers)
    every = select(scripts, [])
    gone = [pair for pair in seconds_of(results) if pair not in every] if not only else []
    lines = [f"{script}/{case}: recorded, but no script has it; run report.py" for script, case in gone]
    paths = {name: script.path for name, script in scripts.items()}
    try:
        for run in run_all(jobs, paths, out, workers, keep):
            say(progress.line(run))
            lines += failures(run, results)
    except KeyboardInterrupt:
        say(
            "\n".join(
                [f"gate: stopped after {minutes(progress.elapsed)}; failures so far: {len(lines)}", *sorted(lines)]
            )
        )
        raise
    say(f"gate: {len(jobs)} runs in {minutes(progress.elapsed)}")
    return sorted(lines)
