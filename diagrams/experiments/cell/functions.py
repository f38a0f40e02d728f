"""The table of safety functions, as certified controllers print theirs: of the runs that were made, no rating."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.cell.judge import CellRun
from saphari_drake.safety.supervisor.law import CellState

Array = NDArray[np.float64]
REST = 0.01  # share of a joint's speed limit, below which it stands
HEAD = "| safety function | limit | trueness | worst detection | worst reaction |\n|---|---|---|---|---|"


def safety_functions(runs: list[CellRun]) -> str:
    """Return a table of what each function is bound to, how true it is, and how soon it acts, over all runs (Markdown).

    Detection is from what happens, by the simulated truth, until a state is published; reaction from there until the
    robot stands, or until another torque acts. A dash: it did not happen.
    """
    touch = runs[0].rig.scenario.pipeline.detector.threshold
    rows = [
        (
            "protective separation",
            "the standard's distance",
            _text(_trueness(runs), "m"),
            "–",
            _text(_stops(runs), "s"),
        ),
        ("touch", f"{touch} Nm (N) a joint", "–", _text(_touches(runs), "s"), "0.005 s (next cycle)"),
        ("fault of a part", "any of the watched statuses", "–", _text(_faults(runs), "s"), _text(_brakes(runs), "s")),
        ("joint speed", "that of the model", _text(_speed(runs), "of the limit"), "0.001 s", "–"),
        ("joint torque", "that of the model", _text(_torque(runs), "of the limit"), "0.001 s", "–"),
    ]
    trials = sum(run.fast.time[-1] for run in runs)
    lines = [HEAD, *("| " + " | ".join(row) + " |" for row in rows)]
    note = f"{len(runs)} runs, {trials:.0f} s. Limits of the body: check against a licensed copy of ISO/TS 15066."
    return "\n".join(lines) + f"\n\n{note}\n"


def _text(values: list[float], unit: str) -> str:
    return f"{max(values):.3g} {unit}" if values else "–"


def _trueness(runs: list[CellRun]) -> list[float]:
    """How much farther people were seen than they were, at most, of all frames with somebody within 0.4 m."""
    found = []
    for run in runs:
        rows = np.searchsorted(run.fast.time, run.slow.time - 1e-9).clip(0, len(run.fast.time) - 1)
        true, seen = run.fast["gap"][rows, 0], run.slow["separation"][:, 0]
        near = np.isfinite(seen) & (true < 0.4) & (run.slow["people_seen"][:, 0] > 0)
        found += (seen - true)[near].tolist()
    return found


def _entries(run: CellRun, state: CellState) -> list[int]:
    states = run.fast["state"][:, 0]
    return (np.flatnonzero((states[1:] == state) & (states[:-1] != state)) + 1).tolist()


def _standing(run: CellRun, start: int) -> float:
    """Time (s) until all joints stand, or until the state changes."""
    speed = (np.abs(run.fast["velocity"][start:]) / run.rig.robot.v_max).max(axis=1)
    changed = run.fast["state"][start:, 0] != run.fast["state"][start, 0]
    end = np.flatnonzero((speed < REST) | changed)
    return float(run.fast.time[start + end[0]] - run.fast.time[start]) if end.size else np.inf


def _stops(runs: list[CellRun]) -> list[float]:
    return [_standing(run, k) for run in runs for k in _entries(run, CellState.STOP)]


def _brakes(runs: list[CellRun]) -> list[float]:
    return [_standing(run, k) for run in runs for k in _entries(run, CellState.FAULT)]


def _touches(runs: list[CellRun]) -> list[float]:
    """Of contacts that were answered: until the state tells it."""
    found = []
    for run in runs:
        entries = np.array([run.fast.time[k] for k in _entries(run, CellState.CONTACT)])
        for k, time in enumerate(entries):
            before = [hit.time for hit in run.hits if (entries[k - 1] if k else 0.0) < hit.time <= time]
            found += [float(time - min(before))] if before else []
    return found


def _faults(runs: list[CellRun]) -> list[float]:
    found = []
    for run in runs:
        if run.rig.scenario.faults:
            entries = _entries(run, CellState.FAULT)
            start = run.rig.scenario.fault_start()
            found.append(float(run.fast.time[entries[0]]) - start if entries else np.inf)
    return found


def _speed(runs: list[CellRun]) -> list[float]:
    return [float((np.abs(run.fast["velocity"]) / run.rig.robot.v_max).max()) for run in runs]


def _torque(runs: list[CellRun]) -> list[float]:
    return [float((np.abs(run.fast["torque"]) / run.rig.robot.tau_max).max()) for run in runs]
