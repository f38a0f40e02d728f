"""The README's tables of experiments, from the file of results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from experiments.evidence.discovery import REALISTIC
from experiments.evidence.readme_rows import Row, Scale
from experiments.evidence.results_file import Results
from experiments.evidence.summary import Bound, bound_text, is_bounded

NOTHING = "–"


def experiments_table(results: Results, rows: Sequence[Row]) -> str:
    """Return the table of all rows whose figures are recorded; a figure beyond its bound is bold."""
    cells, before = [], ""
    for row in rows:
        found = [_figures(results, row.script, case, metric) for case, metric in _names(row)]
        figures = [each for each in found if each is not None]
        if len(figures) < len(found):
            continue
        where = f"`{row.script}` {', '.join(row.cases.split())}"
        on_other = [_figures(results, row.script, case + REALISTIC, metric) for case, metric in _names(row)]
        cells.append(("" if where == before else where, *_row_cells(row, figures, on_other)))
        before = where
    head = ("script and case", "metric", "default seed", "worst seed", "realistic plant", "bound", "the deliverable")
    return table(head, cells)


def missing(results: Results, row: Row) -> list[str]:
    """Return a line for each figure of a row that is not recorded."""
    return [
        f"README row '{row.label}': no {row.script}/{case} {metric}; run report.py --only {row.script}/{case}"
        for case, metric in _names(row)
        if _figures(results, row.script, case, metric) is None
    ]


def short_table(results: Results) -> str:
    """Return what falls short: every bound that a seed misses."""
    cells = [
        (
            f"`{script}` {case}",
            f"`{name}`",
            "no value" if figures["worst"] is None else number(figures["worst"], Scale(unit=_unit(figures))),
            _bound(figures["bound"], Scale(unit=_unit(figures))),
            f"{len(figures['missed'])} of {len(summary['seeds'])}",
            "yes" if figures["decides"] else "no",
        )
        for script, cases in results.items()
        for case, summary in cases.items()
        if summary["plant"] == "ideal"
        for name, figures in summary["metrics"].items()
        if figures["missed"]
    ]
    if not cells:
        return "Nothing: every seed meets every bound."
    return table(("script and case", "metric", "worst seed", "bound", "seeds that miss it", "fails the run"), cells)


def made_text(results: Results) -> str:
    """Return what the figures come from: seeds, plant, machine and versions."""
    summaries = [summary for cases in results.values() for summary in cases.values()]
    machines = _unique(f"{s['machine']['processor']}, {s['machine']['cores']} cores" for s in summaries)
    plants = _unique(summary["plant"] for summary in summaries)
    versions = _unique(f"Drake {s['versions']['drake']}, Python {s['versions']['python']}" for s in summaries)
    return f"{seeds_text(results)}; plant {', '.join(plants)}; {'; '.join(machines)}; {'; '.join(versions)}."


def seeds_text(results: Results) -> str:
    """Return the seeds of most cases on the ideal plant, then scripts with others, and of which cases if not of all."""
    groups: dict[str, dict[str, list[str]]] = {}
    for script, cases in results.items():
        for case, summary in cases.items():
            if summary["plant"] == "ideal" and not all(figures["same"] for figures in summary["metrics"].values()):
                groups.setdefault(_ranges(summary["seeds"]), {}).setdefault(script, []).append(case)
    if not groups:
        return "No seed changes anything"
    usual = max(groups, key=lambda seeds: sum(map(len, groups[seeds].values())))
    others = []
    for seeds, scripts in groups.items():
        names = (" ".join([f"`{script}`", *_some(script, cases, groups)]) for script, cases in scripts.items())
        others += [f"{', '.join(names)}: {seeds}"] if seeds != usual else []
    return f"Seeds {usual}" + (f" ({'; '.join(others)})" if others else "")


def _some(script: str, cases: list[str], groups: dict[str, dict[str, list[str]]]) -> list[str]:
    """Return these cases of a script, or none if no others were run with other seeds."""
    return [" ".join(cases)] if sum(script in scripts for scripts in groups.values()) > 1 else []


def _ranges(seeds: Sequence[int]) -> str:
    """Return seeds as text, those in a row as "first–last"."""
    parts: list[list[int]] = []
    for seed in seeds:
        if parts and seed == parts[-1][-1] + 1:
            parts[-1].append(seed)
        else:
            parts.append([seed])
    return ", ".join(f"{part[0]}–{part[-1]}" if len(part) > 1 else str(part[0]) for part in parts)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("|" + "|".join(f" {cell} " if cell else " " for cell in line) + "|" for line in lines)


def number(value: float | None, scale: Scale) -> str:
    """Return a figure at its scale; no exponent where it has fewer than five digits before the point."""
    if value is None:
        return "no value"
    scaled = scale.factor * value
    digits = "0f" if 10.0 ** (scale.digits - 1) <= abs(scaled) < 1e5 else f"{scale.digits}g"
    return f"{scaled:.{digits}}{scale.unit}"


def _row_cells(
    row: Row, found: Sequence[Mapping[str, Any]], realistic: Sequence[Mapping[str, Any] | None]
) -> tuple[str, ...]:
    bounds = _unique(_bound(figures["bound"], row.scale) for figures in found)
    reported = _unique(figures["reported"] for figures in found if figures["reported"])
    own, other = ([_own(figures, row.scale) for figures in plant] for plant in (found, realistic))
    if all(figures.get("same") for figures in found):
        worst = "same on all seeds"
    else:
        worst = _joined([_worst(figures, row.scale) for figures in found], row.scale)
    texts = _joined(own, row.scale), worst, _joined(other, row.scale) if any(realistic) else NOTHING
    return row.label, *texts, " / ".join(bounds), " / ".join(reported) or NOTHING


def _own(figures: Mapping[str, Any] | None, scale: Scale) -> str:
    """Return the default seed's figure."""
    if figures is None:
        return NOTHING
    return _marked(figures["value"], figures["default_seed"] in figures.get("missed", []), scale)


def _worst(figures: Mapping[str, Any], scale: Scale) -> str:
    if "missed" not in figures or figures["same"] is None:
        return NOTHING
    if is_bounded(figures["bound"]):
        return _marked(figures["worst"], bool(figures["missed"]), scale)
    return f"{number(figures['min'], scale._replace(unit=''))} … {number(figures['max'], scale)}"


def _marked(value: float | None, missed: bool, scale: Scale) -> str:
    text = number(value, scale)
    return f"**{text}**" if missed else text


def _joined(texts: Sequence[str], scale: Scale) -> str:
    """Join figures by slashes with the unit once, at the end."""
    if any(text.startswith("**") for text in texts) or not scale.unit:
        return " / ".join(texts)
    return " / ".join([*(text.removesuffix(scale.unit) for text in texts[:-1]), texts[-1]])


def _bound(bound: Bound, scale: Scale) -> str:
    if not is_bounded(bound):
        return NOTHING
    low, high = (None if side is None else float(f"{scale.factor * side:.4g}") for side in bound)
    return f"{bound_text((low, high))}{scale.unit}"


def _names(row: Row) -> list[tuple[str, str]]:
    return [(case, metric) for case in row.cases.split() for metric in row.metrics.split()]


def _figures(results: Results, script: str, case: str, metric: str) -> dict[str, Any] | None:
    summary = results.get(script, {}).get(case)
    if summary is None:
        return None
    figures = summary["metrics"].get(metric, summary["timings"].get(metric))
    return None if figures is None else {**figures, "default_seed": summary["default_seed"]}


def _unit(figures: Mapping[str, Any]) -> str:
    return "" if figures["unit"] in ("", "1") else f" {figures['unit']}"


def _unique(texts: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(texts))
