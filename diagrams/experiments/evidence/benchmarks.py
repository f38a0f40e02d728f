"""The benchmarks: run one after the other, recorded, and shown in the README's table of speed."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from experiments.evidence.machine import machine
from experiments.evidence.readme_rows import Scale, Speed
from experiments.evidence.readme_tables import NOTHING, number, table
from saphari_drake.errors import SaphariError, UnknownNameError
from saphari_drake.simulation.runner.results import versions

MS = Scale(digits=2)


def run_benchmarks(folder: Path, only: Sequence[str] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
    """Run every benchmark of a folder, or those named, and yield its name and what it wrote."""
    paths = {path.stem: path for path in sorted(folder.glob("benchmark_*.py"))}
    for name in only:
        if name not in paths:
            raise UnknownNameError("benchmark", name, paths)
    for path in [paths[name] for name in paths if not only or name in only]:
        with TemporaryDirectory() as work:
            rows = Path(work) / "rows.json"
            done = subprocess.run([sys.executable, str(path), "--json", str(rows)], capture_output=True, text=True)
            if done.returncode != 0 or not rows.is_file():
                reason = (done.stderr.strip().splitlines() or ["it wrote no rows"])[-1]
                raise SaphariError(f"{path.stem}: exit status {done.returncode}: {reason}")
            found = json.loads(rows.read_text(encoding="utf-8"))
        yield path.stem, {"machine": machine(), "versions": versions(), "rows": found}


def speed_table(benchmarks: Mapping[str, Any], rows: Sequence[Speed]) -> str:
    """Return the table of all rows that are recorded, with the ratio to the peer of the same run."""
    head = ("step", "median", "p95", "p99", "aimed at", "peer, same run", "its median over ours")
    return table(head, [_cells(benchmarks, row) for row in rows if not missing(benchmarks, row)])


def missing(benchmarks: Mapping[str, Any], row: Speed) -> list[str]:
    """Return a line if a row is not recorded."""
    if row.row in benchmarks.get(row.benchmark, {}).get("rows", {}):
        return []
    return [f"README row '{row.label}': no '{row.row}' of {row.benchmark}; run report.py --benchmarks"]


def speed_made_text(benchmarks: Mapping[str, Any]) -> str:
    """Return the machines that the times come from."""
    machines = {
        f"{entry['machine']['processor']}, {entry['machine']['cores']} cores": 0 for entry in benchmarks.values()
    }
    return f"Wall time of one pinned thread, ms; {'; '.join(machines) or 'not measured yet'}."


def _cells(benchmarks: Mapping[str, Any], row: Speed) -> tuple[str, ...]:
    rows = benchmarks[row.benchmark]["rows"]
    found = rows[row.row]
    peer = rows.get(found["peer"])
    aimed = [f"≤ {found['aimed_ms']:g}"] if found["aimed_ms"] is not None else []
    aimed += [f"p95 ≤ {found['aimed_p95_ms']:g}"] if found["aimed_p95_ms"] is not None else []
    return (
        row.label,
        _marked(found["median_ms"], found["aimed_ms"]),
        _marked(found["p95_ms"], found["aimed_p95_ms"]),
        number(found["p99_ms"], MS),
        ", ".join(aimed) or NOTHING,
        NOTHING if peer is None else f"{found['peer']}: {number(peer['median_ms'], MS)}{_note(peer)}",
        NOTHING if found["ratio"] is None else f"{number(found['ratio'], MS)} ×",
    )


def _note(peer: Mapping[str, Any]) -> str:
    return f" ({peer['note']})" if peer["note"] else ""


def _marked(ms: float, aimed: float | None) -> str:
    return f"**{number(ms, MS)}**" if aimed is not None and ms > aimed else number(ms, MS)
