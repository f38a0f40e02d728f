"""Metrics of one run, their verdict, and the files and the table that show them."""

from __future__ import annotations

import json
import platform
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from pydrake.common.yaml import yaml_dump_typed

import saphari_drake
from saphari_drake.errors import ParameterError, SaphariError
from saphari_drake.simulation.record.files import atomic_path, write_text
from saphari_drake.simulation.record.frames import DepthFrame
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.view.mcap import McapFile

TIMING = re.compile(r"_ms(_|$)|^real_time_factor")
RESULTS = ("metrics.json", "log.npz", "figure.png", "replay.html", "run.mcap", "replay.gif")


@dataclass(frozen=True)
class Metric:
    """One number of a run, with the bounds it has to meet.

    Attributes
    ----------
    name : str
        Name with its unit at the end where that helps; ``*_ms_*`` and ``real_time_factor*`` mark timing figures, which
        never decide.
    value : float
        The number; one that is not finite misses its bounds.
    unit : str
        Unit, "" for a pure number.
    low, high : float
        Bounds, both included.
    reported : str
        What the deliverable states, if anything.
    decides : bool
        Whether a missed bound fails the run.
    """

    name: str
    value: float
    unit: str = ""
    low: float = -np.inf
    high: float = np.inf
    reported: str = ""
    decides: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", float(self.value))
        if TIMING.search(self.name):
            object.__setattr__(self, "decides", False)

    @property
    def met(self) -> bool:
        """Whether the value is finite and within its bounds."""
        return bool(np.isfinite(self.value) and self.low <= self.value <= self.high)

    @property
    def verdict(self) -> str:
        """Return "pass" or "FAIL"; in brackets if it does not decide, "–" if there is no bound to miss."""
        if self.met and np.isinf(self.low) and np.isinf(self.high):
            return "–"
        word = "pass" if self.met else "FAIL"
        return word if self.decides else f"({word.lower()})"


@dataclass(frozen=True)
class Outcome:
    """What one run of an experiment gives back.

    Attributes
    ----------
    metrics : sequence of Metric
    log : Log
    draw : callable
        Returns the figure of the run; called only if files are written.
    replay : callable, optional
        Writes the replay to the path, or to the open `McapFile`, that it is given; called only if files are written.
    files : mapping from str to str
        Text of other files, by their names.
    note : str
        What is not judged, and why.
    """

    metrics: Sequence[Metric]
    log: Log
    draw: Callable[[], Figure]
    replay: Callable[[Any], None] | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    note: str = ""

    def __post_init__(self) -> None:
        names = [metric.name for metric in self.metrics]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ParameterError("metrics", f"named more than once: {', '.join(twice)}")

    @property
    def passed(self) -> bool:
        """Whether every metric that decides meets its bounds."""
        return all(metric.met for metric in self.metrics if metric.decides)


class NothingToJudgeError(SaphariError):
    """A run ended before anything happened that is judged."""


def judged_so_far(outcome: Outcome, shortened: bool) -> Outcome:
    """Return an outcome without metrics that a shortened run did not come to, which are NaN: its note names them."""
    missing = [metric.name for metric in outcome.metrics if shortened and np.isnan(metric.value)]
    kept = [metric for metric in outcome.metrics if metric.name not in missing]
    notes = [outcome.note, f"the run ended before: {', '.join(missing)}" if missing else ""]
    return replace(outcome, metrics=kept, note="; ".join(note for note in notes if note))


def bound_text(low: float, high: float) -> str:
    """Return bounds as text: "≤ 0.1", "≥ 0", "1 … 2", or "–" for none."""
    if np.isinf(low) and np.isinf(high):
        return "–"
    if np.isinf(low):
        return f"≤ {high:g}"
    return f"≥ {low:g}" if np.isinf(high) else f"{low:g} … {high:g}"


def table(metrics: Sequence[Metric]) -> str:
    """Return a table of metrics: name, value, unit, bound, what the deliverable reports, verdict."""
    rows: list[tuple[str, ...]] = [("metric", "value", "unit", "bound", "deliverable", "verdict")]
    for metric in metrics:
        bound = bound_text(metric.low, metric.high)
        rows.append(
            (metric.name, f"{metric.value:.4g}", metric.unit or "–", bound, metric.reported or "–", metric.verdict)
        )
    widths = [max(len(row[i]) for row in rows) for i in range(6)]
    rows.insert(1, tuple("─" * width for width in widths))
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in rows)


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    try:
        drake = version("drake")
    except PackageNotFoundError:
        drake = "unknown"
    return {
        "saphari_drake": saphari_drake.__version__,
        "drake": drake,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def metrics_document(outcome: Outcome, scenario_tree: dict[str, Any], seed_matters: bool) -> dict[str, Any]:
    """Return the content of metrics.json; numbers that are not finite (infinite bounds too) become null.

    `seed_matters` tells whether another seed would give other numbers.
    """
    document = {
        "metrics": {metric.name: metric.value for metric in outcome.metrics},
        "bounds": {metric.name: [metric.low, metric.high] for metric in outcome.metrics},
        "verdict": "pass" if outcome.passed else "fail",
        "units": {metric.name: metric.unit for metric in outcome.metrics},
        "decides": {metric.name: metric.decides for metric in outcome.metrics},
        "reported": {metric.name: metric.reported for metric in outcome.metrics},
        "scenario": scenario_tree,
        "versions": versions(),
        "seed_matters": seed_matters,
        "files": sorted(outcome.files),
    }
    return _finite(document)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def prepare_folder(folder: Path, scenario: Any) -> None:
    """Write scenario.yaml and remove the results of an earlier run, so that they cannot pass for those of this one."""
    for name in (*_more_files(folder), *RESULTS):
        (folder / name).unlink(missing_ok=True)
    write_text(folder / "scenario.yaml", yaml_dump_typed(scenario))


def _more_files(folder: Path) -> list[str]:
    """Names of the files that the run before has written beside those of every run."""
    try:
        names = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))["files"]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [name for name in names if isinstance(name, str) and Path(name).name == name]


def write_outputs(
    folder: Path,
    outcome: Outcome,
    scenario_tree: dict[str, Any],
    seed_matters: bool = True,
    also: Collection[str] = (),
    frames: Sequence[DepthFrame] = (),
) -> None:
    """Write metrics.json, log.npz, figure.png and, if there is one, replay.html.

    `also` names mcap (with `frames`) and gif to be written too, or no-pictures: neither figure nor replay.
    """
    metrics, log, picture, page, run, animation = (folder / name for name in RESULTS)
    document = metrics_document(outcome, scenario_tree, seed_matters)
    write_text(metrics, json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    outcome.log.save(log)
    for name, text in outcome.files.items():
        write_text(folder / name, text)
    pictures = "no-pictures" not in also
    if pictures:
        figure = outcome.draw()
        FigureCanvasAgg(figure)
        with atomic_path(picture) as temporary:
            figure.savefig(temporary, dpi=150)
    if pictures and outcome.replay is not None:
        with atomic_path(page) as temporary:
            outcome.replay(temporary)
    if "gif" in also and outcome.replay is not None:
        with atomic_path(animation) as temporary:
            outcome.replay(temporary)
    if "mcap" in also:
        with atomic_path(run) as temporary, McapFile(temporary) as file:
            file.add_log(outcome.log)
            file.add_frames(frames)
            if outcome.replay is not None:
                outcome.replay(file)
