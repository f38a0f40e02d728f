"""Runs of the experiments on arms of a user's own: which bounds each meets, or what it cannot do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.evidence.discovery import Script, select
from experiments.evidence.readme_tables import NOTHING, table
from experiments.evidence.runs import Job, Run, run_all
from saphari_drake.errors import ParameterError

# Script, case, and what makes it short: one or two touches, few scenes, a short dwell.
TRIALS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("contact_impedance", "natural", ("--duration", "11")),
    ("contact_force", "compatible", ("--duration", "7.5")),
    ("contact_alone", "links", ("--duration", "4")),
    ("contact_localization", "one_camera", ("--set", "count=24")),
    ("null_space_ball", "momentum", ("--duration", "9", "--set", "system.cell.ball.dwell=5")),
    ("null_space_wall", "momentum", ()),
    ("null_space_robustness", "momentum", ("--duration", "9", "--set", "system.cell.ball.dwell=2")),
    ("skin_hand_guiding", "end_effector_first", ()),
    ("reverse_priority_planar", "three_level", ("--duration", "4")),
    ("nmpc_manipulator", "both", ()),
    ("identify", "arm", ()),
)
BAD_INPUT = 2


def arm_jobs(models: Sequence[Path], scripts: Mapping[str, Script], only: Sequence[str]) -> list[Job]:
    """Return the runs of all trials, or of those that `only` names, on every model."""
    for model in models:
        if not model.is_file():
            raise ParameterError("--arms", f"no file '{model}'")
    wanted = set(select(scripts, only))
    return [
        Job(script, case, None, model.stem, ("--no-pictures", "--model", str(model.resolve()), *options))
        for script, case, options in TRIALS
        if (script, case) in wanted
        for model in models
    ]


def run_arms(
    jobs: Sequence[Job], scripts: Mapping[str, Script], out: Path, workers: int, keep: bool
) -> Iterator[tuple[Run, dict[str, Any]]]:
    """Run the jobs and yield each as it ends, with what is kept of it."""
    for run in run_all(jobs, {name: script.path for name, script in scripts.items()}, out, workers, keep):
        yield run, arm_entry(run)


def arm_entry(run: Run) -> dict[str, Any]:
    """Return what a run on an arm came to: its missed bounds, or why it could not be made."""
    entry: dict[str, Any] = {"options": list(run.job.options[3:])}
    if not run.complete:
        line = run.complaint.split("error: ", 1)[-1].removeprefix(f"case {run.job.case}: ")
        return {**entry, "made": False, "cannot": line if run.status == BAD_INPUT else f"broke off: {run.complaint}"}
    values, bounds = run.document["metrics"], run.document["bounds"]
    missed = {
        name: {"value": values[name], "bound": bounds[name]}
        for name, decides in run.document["decides"].items()
        if decides and _missed(values[name], bounds[name])
    }
    return {**entry, "made": True, "passed": run.status == 0, "missed": missed}


def _missed(value: float | None, bound: Sequence[float | None]) -> bool:
    low, high = bound
    return value is None or (low is not None and value < low) or (high is not None and value > high)


def arms_table(recorded: Mapping[str, Any]) -> str:
    """Return the table of scripts and arms, with a line for each thing that an arm cannot do."""
    if not recorded:
        return "Not run yet: report.py --arms MODEL."
    lines: list[str] = []
    rows = []
    for script, case, _ in TRIALS:
        name = f"{script}/{case}"
        cells = [_cell(cases.get(name, {}), arm, lines) for arm, cases in recorded.items()]
        rows.append((f"`{script}` {case}", *cells))
    text = table(("script and case", *(f"`{arm}`" for arm in recorded)), rows)
    return "\n".join([text, "", *(f"{k}. {line}" for k, line in enumerate(lines, 1))]) if lines else text


def _cell(entry: Mapping[str, Any], arm: str, lines: list[str]) -> str:
    if not entry:
        return NOTHING
    if not entry["made"]:
        if entry["cannot"] not in lines:
            lines.append(entry["cannot"])
        return f"no ({lines.index(entry['cannot']) + 1})"
    missed = [f"`{name}` {_number(each['value'])}" for name, each in entry["missed"].items()]
    return "met" if entry["passed"] else "misses " + ", ".join(missed)


def _number(value: float | None) -> str:
    return "no value" if value is None else f"{value:.3g}"
