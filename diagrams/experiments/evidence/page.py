"""One HTML page that needs no network: figures with verdicts, distributions, faults, and replays of what was kept."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from experiments.evidence.fault_trials import fault_summary
from experiments.evidence.results_file import Results
from experiments.evidence.summary import bound_text, is_bounded, missed_by
from saphari_drake.simulation.faults.registry import FAULTS
from saphari_drake.simulation.record.files import write_text

NAME = "report.html"
OPEN = 2  # replays that are open at first: each is a 3D view of its own
WIDTH, HEIGHT = 180, 60  # of a distribution, in pixels
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 0.5em 0 1.5em } td, th { padding: 2px 10px; text-align: left }
th { border-bottom: 1px solid #888 } td.n { text-align: right; font-variant-numeric: tabular-nums }
.FAIL { color: #b00020; font-weight: 600 } .pass { color: #00695c } img { max-width: 100% }
iframe { width: 100%; height: 420px; border: 1px solid #ccc } svg { vertical-align: middle }
"""


def write_page(results: Results, faults: Mapping[str, Any], folder: Path) -> Path:
    """Write the page of what is recorded, and of figures, replays and sweeps that lie below a folder; return its path.

    Replays are shown from their own files: the folder stays together.
    """
    path = folder / NAME
    parts = [
        *_results(results),
        *_faults(faults),
        *_sweeps(sorted(folder.rglob("summary.json")), folder),
        *_figures(sorted(folder.rglob("figure.png")), folder),
        *_replays(sorted(folder.rglob("replay.html")), folder),
    ]
    head = f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Report</title><style>{STYLE}</style>'
    icon = '<link rel="icon" href="data:,">'
    write_text(
        path, "\n".join([f"{head}{icon}</head><body><h1>What the experiments show</h1>", *parts, "</body></html>"])
    )
    return path


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of cells that are HTML already."""
    top = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def distribution(quantiles: Sequence[float], bound: Sequence[float | None]) -> str:
    """Return a picture (SVG) of how values are distributed: the share of trials up to each, and the bounds."""
    sides = [side for side in bound if side is not None]
    low, high = min([*quantiles, *sides]), max([*quantiles, *sides])
    scale = (WIDTH - 4.0) / ((high - low) or 1.0)
    last = len(quantiles) - 1
    points = " ".join(
        f"{2.0 + scale * (value - low):.1f},{HEIGHT - 2.0 - k / last * (HEIGHT - 4.0):.1f}"
        for k, value in enumerate(quantiles)
    )
    lines = "".join(
        f'<line x1="{2.0 + scale * (side - low):.1f}" x2="{2.0 + scale * (side - low):.1f}" y1="0" y2="{HEIGHT}" '
        'stroke="#b00020" stroke-dasharray="3"/>'
        for side in sides
    )
    return (
        f'<svg class="distribution" width="{WIDTH}" height="{HEIGHT}"><polyline points="{points}" fill="none" '
        f'stroke="#0072b2" stroke-width="1.5"/>{lines}</svg>'
    )


def _median(quantiles: Sequence[float]) -> float:
    return quantiles[len(quantiles) // 2]


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _verdict(value: float | None, bound: tuple[float | None, float | None], decides: bool = True) -> str:
    if not is_bounded(bound):
        return "–"
    word = "FAIL" if missed_by(value, bound) > 0.0 else "pass"
    return f'<span class="{word}">{word if decides else f"({word.lower()})"}</span>'


def _results(results: Results) -> Iterator[str]:
    for script, cases in results.items():
        yield f"<h2>{escape(script)}</h2>"
        for case, summary in cases.items():
            seeds, made = (
                summary["seeds"],
                ", ".join(f"{name} {number}" for name, number in summary["versions"].items()),
            )
            rows = [
                (
                    escape(name), _number(found["value"]), _number(found["worst"]), escape(found["unit"]),
                    escape(bound_text(tuple(found["bound"]))), escape(found["reported"]) or "–",
                    _verdict(found["value"], tuple(found["bound"]), found["decides"]),
                )
                for name, found in summary["metrics"].items()
            ]  # fmt: skip
            yield f"<h3>{escape(case)}</h3><p>{len(seeds)} seeds, plant {escape(summary['plant'])}; {escape(made)}</p>"
            yield table(("metric", "value", "worst seed", "unit", "bound", "deliverable", "verdict"), rows)


def _faults(recorded: Mapping[str, Any]) -> Iterator[str]:
    rows = [
        (
            escape(fault), escape(FAULTS[fault].about) if fault in FAULTS else "–", escape(case),
            f"{entry['told']} of {entry['acting']}", f"{entry['soon']}", _number(entry["reaction_max_s"]),
            _number(entry["speed_share_max"]),
        )
        for fault, cases in recorded.items()
        for case, trials in cases.items()
        for entry in (fault_summary(trials),)
    ]  # fmt: skip
    if rows:
        yield "<h2>Faults</h2>"
        head = (
            "fault",
            "what",
            "case",
            "told of those with an effect",
            "within 0.1 s",
            "latest [s]",
            "largest joint speed over its limit",
        )
        yield table(head, rows)


def _sweeps(paths: Sequence[Path], folder: Path) -> Iterator[str]:
    if paths:
        yield "<h2>Sweeps</h2>"
    for path in paths:
        summary = json.loads(path.read_text(encoding="utf-8"))
        if "rate" not in summary:
            continue
        plan, (rate, low, high) = summary["plan"], summary["rate"]
        place = escape(str(path.parent.relative_to(folder)))
        yield f"<h3>{escape(plan['script'])} / {escape(plan['case'])} ({place})</h3>"
        failing = ", ".join(str(number) for number in summary["failing"][:40]) or "none"
        yield (
            f"<p>{summary['met']} of {summary['trials']} trials met all they have to: {rate:.1%}, 95 % interval "
            f"{low:.1%} … {high:.1%}. Failing trials: {failing}.</p>"
        )
        rows = [
            (
                escape(name), _number(_median(found["quantiles"])), _number(found["worst"]), str(found["worst_trial"]),
                distribution(found["quantiles"], found["bound"]), _verdict(found["worst"], tuple(found["bound"])),
            )
            for name, found in summary["metrics"].items()
        ]  # fmt: skip
        yield table(("metric", "median", "worst", "in trial", "share of trials up to a value", "worst in bound"), rows)


def _figures(paths: Sequence[Path], folder: Path) -> Iterator[str]:
    if paths:
        yield "<h2>Figures</h2>"
    for path in paths:
        name = escape(str(path.parent.relative_to(folder)))
        picture = b64encode(path.read_bytes()).decode("ascii")
        yield f'<h3>{name}</h3><img alt="{name}" src="data:image/png;base64,{picture}">'


def _replays(paths: Sequence[Path], folder: Path) -> Iterator[str]:
    if paths:
        yield "<h2>Replays</h2>"
    for k, path in enumerate(paths):
        place = escape(path.relative_to(folder).as_posix())
        shown, later = (" open", "eager") if k < OPEN else ("", "lazy")
        yield f'<details{shown}><summary>{place}</summary><iframe loading="{later}" src="{place}"></iframe></details>'
