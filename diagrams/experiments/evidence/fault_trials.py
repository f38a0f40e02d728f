"""Trials of every fault: whether and how soon it is answered by a published safe state, and what the joints did."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.evidence.discovery import Script
from experiments.evidence.readme_rows import S_AS_MS, SECONDS
from experiments.evidence.readme_tables import NOTHING, number, table
from experiments.evidence.runs import Job, Run, run_all
from saphari_drake.simulation.faults.registry import FAULTS

# Script, case, and how long it runs (s; 0: as long as it does by itself), with the fault at a time drawn from the seed.
TRIALS = (
    ("contact_impedance", "natural", 4.0),
    ("nmpc_manipulator", "both", 3.0),
    ("null_space_wall", "momentum", 0.0),
)
SOON = 0.1  # s
BAD_INPUT = 2  # exit status: the case does not have what the fault acts on


def fault_jobs(seeds: Sequence[int], faults: Sequence[str]) -> list[Job]:
    """Return the runs of all trials."""
    return [
        Job(script, case, seed, fault, ("--set", f"faults=[{fault}]", *(("--duration", str(time)) if time else ())))
        for fault in faults or FAULTS
        for script, case, time in TRIALS
        for seed in seeds
    ]


def run_faults(
    scripts: Mapping[str, Script], seeds: Sequence[int], faults: Sequence[str], out: Path, workers: int, keep: bool
) -> Iterator[Run]:
    """Run all trials and yield each as it ends."""
    yield from run_all(
        fault_jobs(seeds, faults), {name: script.path for name, script in scripts.items()}, out, workers, keep
    )


def fault_summary(runs: Sequence[Run]) -> dict[str, Any]:
    """Return what trials of one fault on one case come to; nothing if the case does not have what it acts on."""
    made = [run for run in runs if run.complete]
    if not made:
        impossible = all(run.status == BAD_INPUT and "fault" in run.complaint for run in runs)
        return {} if impossible else {"trials": len(runs), "made": 0, "complaint": runs[0].complaint}
    metrics = [run.document["metrics"] for run in made]
    reactions = [math.inf if values["fault_reaction_s"] is None else values["fault_reaction_s"] for values in metrics]
    finite = [reaction for reaction in reactions if reaction < math.inf]
    speeds = [values.get("joint_speed_share_max") or 0.0 for values in metrics]
    return {
        "trials": len(runs),
        "made": len(made),
        "answered": len(finite),
        "soon": sum(reaction <= SOON for reaction in finite),
        "reaction_max_s": max(finite, default=None),
        "speed_share_max": max(speeds),
        "worst_seed": made[speeds.index(max(speeds))].job.seed,
    }


def faults_table(recorded: Mapping[str, Any]) -> str:
    """Return the table of faults: of the trials of each case, how many were answered and how late at most."""
    names = [f"{script}/{case}" for script, case, _ in TRIALS]
    head = ("fault", "what", *(f"`{name}`" for name in names), "largest joint speed over its limit")
    rows = []
    for fault, about in FAULTS.items():
        cases = recorded.get(fault, {})
        if any(cases.values()):
            speeds = {name: entry["speed_share_max"] for name, entry in cases.items() if entry.get("made")}
            worst = max(speeds, key=lambda name: speeds[name], default="")
            told = f"{speeds[worst]:.2f} ({worst}, seed {cases[worst]['worst_seed']})" if worst else NOTHING
            rows.append((f"`{fault}`", about.about, *(_cell(cases.get(name, {})) for name in names), told))
    return table(head, rows) if rows else "Not run yet: report.py --faults."


def _cell(entry: Mapping[str, Any]) -> str:
    if not entry:
        return NOTHING
    if not entry["made"]:
        return "run not judged"
    count = f"{entry['answered']} of {entry['made']}"
    if not entry["answered"]:
        return f"no state published ({count})"
    late = entry["reaction_max_s"]
    return f"{number(late, S_AS_MS if late < 1.0 else SECONDS)} ({count})"
