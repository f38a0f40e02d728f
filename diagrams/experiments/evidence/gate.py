"""The gate: every case ends with 0, and its figures are those that are recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from experiments.evidence.discovery import REALISTIC, Script, select
from experiments.evidence.progress import Progress, minutes
from experiments.evidence.recording import Say, seconds_of
from experiments.evidence.results_file import Results, read_results
from experiments.evidence.runs import Job, Run, run_all
from experiments.evidence.summary import Bound, allowed_difference, bound_text, is_bounded, missed_by
from saphari_drake.simulation.runner.results import TIMING

MAIN_SCRIPT = "contact_impedance"
# Differences smaller than the simulated sensors tell apart (encoders 1e-6, torques 0.01) are none; rounding elsewhere.
RESOLUTION = {"m": 1e-6, "rad": 1e-6, "N": 1e-2, "Nm": 1e-2}
ROUNDING = 1e-9


def seed_of_the_day(today: date) -> int:
    """Return the date as a seed, as in 20260131."""
    return int(today.strftime("%Y%m%d"))


def gate_jobs(pairs: Sequence[tuple[str, str]], seed: int, results: Results, main: str = MAIN_SCRIPT) -> list[Job]:
    """Return every case with its default seed and the main script's cases with `seed`, longest first as recorded."""
    jobs = [Job(*pair) for pair in pairs] + [Job(*pair, seed) for pair in pairs if pair[0] == main]
    return sorted(jobs, key=lambda job: -results.get(job.script, {}).get(job.case, {}).get("seconds", 0.0))


def failures(run: Run, results: Results) -> list[str]:
    """Return what is wrong with a run, a line each: its exit status, its bounds, and figures off the recorded ones.

    On the realistic plant a missed bound is a finding, and recorded: there the figures alone count.
    """
    name = f"{run.job.script}/{run.job.case}"
    which = name if run.job.seed is None else run.job.name
    if not run.complete:
        return [f"{which}: exit status {run.status}: {run.complaint or 'no message and no metrics'}"]
    found = run.status != 0 and not run.job.case.endswith(REALISTIC)
    lines = [f"{which}: {line}" for line in missed_bounds(run.document)] if found else []
    if found and not lines:
        lines = [f"{which}: exit status {run.status}, although every bound that decides is met"]
    if run.job.seed is not None:
        return lines
    recorded = results.get(run.job.script, {}).get(run.job.case)
    if recorded is None:
        return [*lines, f"{name}: not recorded; run report.py --only {name}"]
    moved = figures_off(run.document, recorded)
    return lines + [f"{name}: {line}; if that is meant, run report.py --only {name}" for line in moved]


def missed_bounds(document: Mapping[str, Any]) -> list[str]:
    """Return a line for each metric that decides and misses its bound."""
    return [
        f"{metric} {text(value)} misses its bound {bound_text(document['bounds'][metric])}"
        for metric, value in document["metrics"].items()
        if document["decides"][metric] and missed_by(value, document["bounds"][metric]) > 0.0
    ]


def figures_off(document: Mapping[str, Any], recorded: Mapping[str, Any]) -> list[str]:
    """Return a line for each figure or bound that is off the recorded one, disappeared, or is new and has a bound."""
    values = {name: value for name, value in document["metrics"].items() if not TIMING.search(name)}
    known = recorded["metrics"]
    lines = [f"{name}: recorded {text(known[name]['value'])}, not there any more" for name in known.keys() - values]
    for name, value in values.items():
        bound = document["bounds"][name]
        if name not in known:
            lines += [f"{name} {text(value)}: has a bound and is not recorded"] if is_bounded(bound) else []
            continue
        was, allowed = known[name]["value"], known[name]["allowed"]
        if not close(value, was, max(allowed, RESOLUTION.get(document["units"][name], ROUNDING))):
            lines.append(f"{name} {text(value)}, recorded {text(was)}, allowed difference {allowed:.2g}")
        if moved_bound(bound, known[name]["bound"]):
            lines.append(f"{name}: bound {bound_text(bound)}, recorded {bound_text(known[name]['bound'])}")
        if document["decides"][name] != known[name]["decides"]:
            lines.append(f"{name}: decides the verdict or not, other than recorded")
    return sorted(lines)


def close(value: float | None, recorded: float | None, allowed: float) -> bool:
    """Whether two figures differ by no more than is allowed; a missing one equals a missing one alone."""
    if value is None or recorded is None:
        return value is recorded
    return abs(value - recorded) <= allowed


def moved_bound(bound: Bound, recorded: Bound) -> bool:
    """Whether a side of the bound came, went or moved by more than 2 %: some bounds follow from the run itself."""
    return any(not close(now, was, allowed_difference(was, 0.0, (None, None))) for now, was in zip(bound, recorded))


def text(value: float | None) -> str:
    """Return a figure with four digits."""
    return "no value" if value is None else f"{value:.4g}"


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
    """Run every case with its default seed, and the main script with the seed of the day; return what fails.

    Cases on the realistic plant are run where `only` names them or their script.
    """
    results, seed = read_results(results_path), seed_of_the_day(date.today())
    pairs = [pair for pair in select(scripts, only) if only or not pair[1].endswith(REALISTIC)]
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
