"""Rows on disk: a journal while the sweep runs, from which it goes on, and tables in the end."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.sweep.plan import Plan
from experiments.sweep.worker import Row
from experiments.trials import interval
from saphari_drake.errors import ParameterError, SaphariError
from saphari_drake.simulation.record.files import atomic_path, write_text
from saphari_drake.simulation.runner.results import versions

PLAN, JOURNAL, SUMMARY = "plan.json", "journal.jsonl", "summary.json"
TRIALS, TIMES, FAILURES = "trials.parquet", "times.parquet", "failures.txt"
SHARES = np.linspace(0.0, 1.0, 21)  # of the quantiles that are kept
ABOUT = ("trial", "met", "error")


class Journal:
    """The rows of a sweep in a folder, each written as soon as it is known.

    Raises
    ------
    ParameterError
        If the folder holds another sweep.
    """

    def __init__(self, folder: Path, plan: Plan) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.plan, text = folder, plan, json.dumps(plan.document, indent=2)
        if (folder / PLAN).is_file() and (folder / PLAN).read_text(encoding="utf-8") != text:
            raise ParameterError("--out", f"{folder} holds another sweep; choose a folder of its own")
        write_text(folder / PLAN, text)
        self.path = folder / JOURNAL
        if self.path.is_file() and not self.path.read_bytes().endswith(b"\n"):
            with self.path.open("ab") as file:  # a line that was cut off
                file.write(b"\n")
        self.done = {row.row: row.values for row in self.rows()}

    def rows(self) -> list[Row]:
        """Return all rows, in order; a line that was cut off is left out."""
        if not self.path.is_file():
            return []
        found = {}
        for line in self.path.read_text(encoding="utf-8").splitlines():
            try:
                row = Row(*json.loads(line))
            except ValueError:
                continue
            found[row.row] = row
        return [found[number] for number in sorted(found)]

    def add(self, row: Row) -> None:
        """Keep a row."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        self.done[row.row] = row.values


def write_tables(journal: Journal) -> dict[str, Any]:
    """Write the tables and return the summary."""
    rows = journal.rows()
    _write_parquet(journal.folder / TRIALS, [{"row": row.row, **row.values} for row in rows])
    _write_parquet(journal.folder / TIMES, [{"row": row.row, **row.times} for row in rows])
    bounds = {name: bound for row in rows for name, bound in row.bounds.items()}
    summary = summarize(journal.plan, [row.values for row in rows], bounds)
    summary["memory_MB"] = _memory(rows)
    write_text(journal.folder / SUMMARY, json.dumps(_finite(summary), indent=2, ensure_ascii=False) + "\n")
    failed = [f"row {row.row}, trial {row.values['trial']}: {row.values['error']}" for row in rows
              if not row.values["met"]]  # fmt: skip
    write_text(journal.folder / FAILURES, "".join(f"{line}\n" for line in failed))
    return summary


def summarize(plan: Plan, rows: list[dict[str, Any]], bounds: Mapping[str, list[float]]) -> dict[str, Any]:
    """Return rate and interval of the trials that met all, and each metric's quantiles and worst row."""
    met = [bool(row["met"]) for row in rows]
    low, high = interval(sum(met), len(met))
    metrics = {}
    for name, bound in bounds.items():
        values = np.array([row.get(name, math.nan) for row in rows], dtype=float)
        finite = np.flatnonzero(np.isfinite(values))
        if finite.size and name not in plan.vary:
            least_is_worst = math.isfinite(bound[0]) and not math.isfinite(bound[1])
            order = finite[np.argsort(values[finite])]
            metrics[name] = {
                "quantiles": np.quantile(values[finite], SHARES).tolist(),
                "worst": float(values[order[0 if least_is_worst else -1]]),
                "worst_trial": rows[order[0 if least_is_worst else -1]]["trial"],
                "bound": bound,
                "missing": int(values.size - finite.size),
            }
    return {
        "plan": plan.document,
        "trials": len(rows),
        "met": sum(met),
        "errors": sum(bool(row["error"]) for row in rows),
        "rate": [sum(met) / max(1, len(met)), low, high],
        "failing": [row["trial"] for row in rows if not row["met"]],
        "metrics": metrics,
        "versions": versions(),
    }


def _memory(rows: list[Row]) -> list[float]:
    """Return the largest memory of any worker over the first and over the last quarter of the rows (MB)."""
    sizes = [row.times.get("memory_MB", 0.0) for row in rows]
    quarter = max(1, len(sizes) // 4)
    return [max(sizes[:quarter], default=0.0), max(sizes[-quarter:], default=0.0)]


def _write_parquet(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write rows as columns; a value that is missing in some becomes null."""
    pyarrow, parquet = pyarrow_parquet()
    names = list(dict.fromkeys(name for row in rows for name in row))
    names.sort(key=lambda name: (name != "row", name not in ABOUT, name))
    table = pyarrow.table({name: pyarrow.array([row.get(name) for row in rows]) for name in names})
    with atomic_path(path) as temporary:
        parquet.write_table(table, temporary)


def pyarrow_parquet() -> tuple[Any, Any]:
    """Return the modules that write tables."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise SaphariError("a sweep needs the extra sweep: pip install 'saphari_drake[sweep]'") from error
    return pyarrow, pyarrow.parquet


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
