"""Trials of every fault: whether and how soon it is answered by a published safe state, and what the joints did."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from queue import SimpleQueue
from threading import Thread
from typing import Any

from experiments.evidence.fault_run import Trial
from experiments.evidence.readme_rows import S_AS_MS, SECONDS
from experiments.evidence.readme_tables import NOTHING, number, table
from experiments.evidence.runs import THREADS
from saphari_drake.errors import SaphariError
from saphari_drake.simulation.faults.registry import FAULTS

TRIALS = (
    Trial("contact_impedance", "natural", 1.2, 2.4),
    Trial("nmpc_manipulator", "both", 0.2, 1.5),
    Trial("skin_hand_guiding", "body_first", 0.8, 1.9),
    Trial("null_space_ball", "momentum", 1.0, 2.0),
)
SOON = 0.1  # s


def run_faults(folder: str, faults: Sequence[str], seeds: Sequence[int], workers: int) -> Iterator[tuple[str, dict]]:
    """Run all trials, a process a case; yield case and result of each as it ends.

    Raises
    ------
    SaphariError
        If a process breaks off.
    """
    results: SimpleQueue = SimpleQueue()
    waiting, running = list(TRIALS), 0
    while waiting or running:
        while waiting and running < workers:
            trial, running = waiting.pop(0), running + 1
            Thread(target=_run_case, args=(trial, folder, faults, seeds, results), daemon=True).start()
        name, result = results.get()
        if isinstance(result, dict):
            yield name, result
        elif result is None:
            running -= 1
        else:
            raise SaphariError(f"trials of {name} broke off: {result}")


def _run_case(trial: Trial, folder: str, faults: Sequence[str], seeds: Sequence[int], results: SimpleQueue) -> None:
    numbers = (trial.script, trial.case, str(trial.earliest), str(trial.latest))
    command = [sys.executable, "-m", "experiments.evidence.fault_run", *numbers, ",".join(faults or FAULTS)]
    environment = {**os.environ, **dict.fromkeys(THREADS, "1")}
    environment["PYTHONPATH"] = os.pathsep.join([folder, *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
    process = subprocess.Popen(
        [*command, ",".join(map(str, seeds))], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder,
        env=environment,
    )  # fmt: skip
    for line in process.stdout or ():
        results.put((trial.name, json.loads(line)))
    said = process.stderr.read().strip().splitlines() if process.stderr else []
    results.put((trial.name, None if process.wait() == 0 else (said or ["no reason given"])[-1]))


def recorded_trial(result: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is kept of a trial; what never was is null."""
    kept = {name: result[name] for name in ("start", "observable", "reaction", "speed_share")}
    return {name: value if math.isfinite(value) else None for name, value in kept.items()}


def fault_summary(trials: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return what trials of one fault on one case, by seed, come to."""
    acting = {seed: trial for seed, trial in trials.items() if trial["observable"] is not None}
    told = {seed: trial for seed, trial in acting.items() if trial["reaction"] is not None}
    worst = max(trials, key=lambda seed: trials[seed]["speed_share"] or 0.0)
    return {
        "trials": len(trials),
        "acting": len(acting),
        "told": len(told),
        "soon": sum(trial["reaction"] <= SOON for trial in told.values()),
        "reaction_max_s": max((trial["reaction"] for trial in told.values()), default=None),
        "silent_seeds": [int(seed) for seed in acting if seed not in told],
        "speed_share_max": trials[worst]["speed_share"] or 0.0,
        "worst_seed": int(worst),
    }


def faults_table(recorded: Mapping[str, Any]) -> str:
    """Return the table of faults: of the trials of each case, how many were answered and how late at most."""
    names = [trial.name for trial in TRIALS]
    head = ("fault", "what", *(f"`{name}`" for name in names), "largest joint speed over its limit")
    rows = []
    for fault, about in FAULTS.items():
        cases = {name: fault_summary(recorded[fault][name]) for name in names if name in recorded.get(fault, {})}
        if cases:
            what = about.about + (f"; bounded, not told: {about.bounded}" if about.bounded else "")
            cells = (_cell(cases.get(name, {}), bool(about.bounded)) for name in names)
            rows.append((f"`{fault}`", what, *cells, fastest(cases)))
    return table(head, rows) if rows else "Not run yet: report.py --faults."


def fastest(cases: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the largest joint speed over its limit of trials by case, and the trial it was in."""
    worst = max(cases, key=lambda name: cases[name]["speed_share_max"])
    return f"{cases[worst]['speed_share_max']:.2f} ({worst}, seed {cases[worst]['worst_seed']})"


def seconds(value: float) -> str:
    """Return a time (s) as text."""
    return number(value, S_AS_MS if value < 1.0 else SECONDS)


def _cell(entry: Mapping[str, Any], bounded: bool) -> str:
    if not entry:
        return NOTHING
    if bounded and not entry["told"]:
        return f"bounded, joint speed ≤ {entry['speed_share_max']:.2f} ({entry['trials']})"
    if not entry["acting"]:
        return f"no effect above the noise ({entry['trials']})"
    count = f"{entry['told']} of {entry['acting']}"
    if not entry["told"]:
        return f"**no state published** ({count})"
    late = seconds(entry["reaction_max_s"])
    sound = bounded or entry["soon"] == entry["acting"]
    return f"{late} ({count})" if sound else f"**{late}** ({count}, {entry['soon']} within {seconds(SOON)})"
