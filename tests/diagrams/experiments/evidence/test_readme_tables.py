"""The README's tables: what a row shows, what is bold, what is left out, and what is between markers."""

import json

import numpy as np
import pytest
from bench import Timings
from evidence_runs import made
from experiments.evidence import benchmarks as speed
from experiments.evidence.markers import with_blocks, without_blocks
from experiments.evidence.readme_rows import EXPERIMENTS, MM, PERCENT, PLAIN, SPEED_TABLE, Row, Scale, Speed
from experiments.evidence.readme_tables import experiments_table, made_text, missing, number, seeds_text, short_table
from experiments.evidence.summary import summarize_case

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.results import Metric, Outcome, metrics_document

BOUND = (None, 0.01, True)
RUNS = {
    0: {"error": (0.002, *BOUND), "soft": (0.4, None, 0.3, False), "count": (3.0, None, None, True)},
    1: {"error": (0.004, *BOUND), "soft": (0.2, None, 0.3, False), "count": (3.0, None, None, True)},
    2: {"error": (0.020, *BOUND), "soft": (0.2, None, 0.3, False), "count": (3.0, None, None, True)},
}
HEAD = 2  # lines


def results(*seeds):
    runs = [made({**RUNS[seed], "step_ms_median": (1.0 + seed, None, 0.5, False)}, seed) for seed in seeds]
    return {"toy": {"a": summarize_case(runs, 0)}}


def cells(metrics, scale=PLAIN, seeds=(0, 1, 2)):
    """Return the cells of the row that shows these metrics."""
    line = experiments_table(results(*seeds), [Row("toy", "a", metrics, "what", scale)]).splitlines()[HEAD]
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_a_row_shows_value_worst_bound_and_what_is_reported():
    assert cells("error", MM, (0, 1)) == [
        "`toy` a", "what", "2 mm", "4 mm", "–", "≤ 10 mm", "error in the deliverable"
    ]  # fmt: skip


def test_the_realistic_plant_is_shown_beside_the_ideal_one():
    both = results(0, 1)
    both["toy"]["a/realistic"] = summarize_case([made({"error": (0.03, *BOUND)})], 0) | {"plant": "realistic"}
    line = experiments_table(both, [Row("toy", "a", "error", "what", MM)]).splitlines()[HEAD]
    assert "| 2 mm | 4 mm | **30 mm** | ≤ 10 mm |" in line
    assert "realistic" not in short_table(both)


def test_a_figure_beyond_its_bound_is_bold():
    assert cells("error", MM)[2:4] == ["2 mm", "**20 mm**"]
    assert cells("soft", PERCENT)[2:6] == ["**40 %**", "**40 %**", "–", "≤ 30 %"]


def test_worst_is_told_only_where_a_seed_changes_something():
    """One seed alone tells nothing about it."""
    assert cells("count")[2:5] == ["3", "same on all seeds", "–"]
    assert cells("error", MM, (0,))[2:4] == ["2 mm", "–"]


def test_figures_share_a_row_and_its_unit():
    assert cells("error count", MM, (0, 1))[2:6] == ["2 / 3000 mm", "4 / 3000 … 3000 mm", "–", "≤ 10 mm / –"]


def test_a_timing_is_shown_and_not_compared():
    assert cells("step_ms_median")[2:6] == ["1", "–", "–", "≤ 0.5"]


def test_a_script_is_named_once():
    lines = experiments_table(results(0, 1), [Row("toy", "a", "error", "one"), Row("toy", "a", "count", "two")])
    assert [line.startswith("| `toy` a |") for line in lines.splitlines()[HEAD:]] == [True, False]


def test_a_row_without_its_figures_is_left_out_and_named():
    rows = [Row("toy", "a", "error gone", "half"), Row("toy", "b", "error", "other"), Row("toy", "a", "error", "whole")]
    lines = experiments_table(results(0, 1), rows).splitlines()
    assert len(lines) == HEAD + 1 and "whole" in lines[HEAD]
    assert missing(results(0), rows[0]) == ["README row 'half': no toy/a gone; run report.py --only toy/a"]
    assert missing(results(0), rows[1]) == ["README row 'other': no toy/b error; run report.py --only toy/b"]
    assert missing(results(0), rows[2]) == []


def test_what_falls_short_is_every_missed_bound_whether_it_decides_or_not():
    """Timings are not among them."""
    assert short_table(results(0, 1, 2)).splitlines()[HEAD:] == [
        "| `toy` a | `error` | 0.02 m | ≤ 0.01 m | 1 of 3 | yes |",
        "| `toy` a | `soft` | 0.4 m | ≤ 0.3 m | 1 of 3 | no |",
    ]
    assert short_table({}) == "Nothing: every seed meets every bound."


def test_a_seed_without_a_value_falls_short():
    runs = [made({"error": (value, None, 1.0, True)}, seed) for seed, value in enumerate((0.1, None))]
    summary = {"toy": {"a": summarize_case(runs, 0)}}
    assert "| no value |" in short_table(summary)
    assert "**no value**" in experiments_table(summary, [Row("toy", "a", "error", "what", MM)])


def test_what_the_figures_come_from_is_told():
    text = made_text(results(0, 1, 2))
    assert text.startswith("Seeds 0–2; plant ideal; ") and "Drake 1, Python 3" in text


def test_cases_with_other_seeds_than_most_are_named():
    """Seeds in a row are a range; a case that a seed does not change has none to name."""

    def case(seeds, seedless=False):
        runs = [made({"error": (0.1 + 0.01 * seed, None, 1.0, True)}, seed) for seed in seeds]
        return summarize_case(runs, seeds[0], seedless)

    cases = {"a": case([0, 1, 2]), "b": case([0, 1, 2]), "c": case([0, 1, 2, 3, 21]), "d": case([0], seedless=True)}
    assert seeds_text({"toy": cases}) == "Seeds 0–2 (`toy` c: 0–3, 21)"
    assert seeds_text({"toy": cases, "other": {"e": case([0, 1])}}) == "Seeds 0–2 (`toy` c: 0–3, 21; `other`: 0–1)"
    assert seeds_text({"toy": {"d": cases["d"]}}) == "No seed changes anything"


@pytest.mark.parametrize(
    "value, scale, text",
    [
        (0.0005201, Scale(1e3, " mm"), "0.52 mm"),
        (0.20172, Scale(1.0, " m", 4), "0.2017 m"),
        (3e-10, Scale(1.0, " m/s"), "3e-10 m/s"),
        (1234.5, Scale(), "1234"),
        (0.0, Scale(), "0"),
        (999.9, Scale(), "1000"),
        (None, Scale(1.0, " m"), "no value"),
    ],
)
def test_numbers_are_short(value, scale, text):
    assert number(value, scale) == text


def test_blocks_are_replaced_between_their_markers():
    text = "a\n<!-- results:x -->\nold\n<!-- /results -->\nb\n"
    new, other = with_blocks([text, text.replace(":x", ":y")], {"x": "new", "y": "other"})
    assert new == "a\n<!-- results:x -->\n\nnew\n\n<!-- /results -->\nb\n" and "other" in other
    assert with_blocks([new], {"x": "new"}) == [new]
    assert without_blocks(new) == "a\n\nb\n"


@pytest.mark.parametrize("names", [[], ["y"], ["x", "x"], ["x", "y"]])
def test_markers_and_blocks_must_be_the_same(names):
    text = "".join(f"<!-- results:{name} -->\n<!-- /results -->\n" for name in names)
    with pytest.raises(ParameterError, match="marker"):
        with_blocks([text], {"x": "new"})


def test_rows_of_the_readme_differ():
    """Two rows of a script with one label could not be told apart."""
    labels = [(row.script, row.cases, row.label) for row in EXPERIMENTS]
    assert len(set(labels)) == len(labels)
    assert len({(row.benchmark, row.row) for row in SPEED_TABLE}) == len(SPEED_TABLE)


def timed(tmp_path):
    """Return what is recorded of a benchmark whose row takes 1 to 101 ms and whose peer takes twice that."""
    timings, seconds = Timings(), 1e-3 * np.arange(1, 102)
    timings.add("ours", seconds, aimed_ms=50.0, aimed_p95_ms=100.0, peer="theirs")
    timings.add("theirs", 2.0 * seconds, note="one task")
    timings.add("alone", seconds, peer="not installed")
    timings.write(tmp_path / "rows.json")
    rows = json.loads((tmp_path / "rows.json").read_text())
    return {"benchmark_toy": {"machine": {"processor": "P", "cores": 2}, "versions": {}, "rows": rows}}


def test_a_benchmark_writes_quantiles_and_the_ratio_to_its_peer(tmp_path):
    rows = timed(tmp_path)["benchmark_toy"]["rows"]
    assert [rows["ours"][key] for key in ("median_ms", "p95_ms", "p99_ms", "ratio")] == pytest.approx([51, 96, 100, 2])
    assert rows["ours"]["steps"] == 101 and rows["theirs"]["peer"] is None and rows["alone"]["ratio"] is None


def test_two_rows_of_a_benchmark_have_two_names():
    timings = Timings()
    timings.add("ours", np.ones(2))
    with pytest.raises(ValueError, match="ours"):
        timings.add("ours", np.ones(2))


def test_a_row_of_speed_shows_what_is_aimed_at_and_the_peer(tmp_path):
    rows = [Speed("benchmark_toy", "ours", "our step"), Speed("benchmark_toy", "alone", "other")]
    text = speed.speed_table(timed(tmp_path), [*rows, Speed("benchmark_toy", "gone", "left out")])
    assert text.splitlines()[HEAD:] == [
        "| our step | **51** | 96 | 100 | ≤ 50, p95 ≤ 100 | theirs: 102 (one task) | 2 × |",
        "| other | 51 | 96 | 100 | – | – | – |",
    ]
    line = "README row 'left out': no 'gone' of benchmark_toy; run report.py --benchmarks"
    assert speed.missing(timed(tmp_path), Speed("benchmark_toy", "gone", "left out")) == [line]
    assert speed.speed_made_text({}).endswith("not measured yet.")


def test_metrics_tell_whether_they_decide_and_what_is_reported():
    """Of a run, as written to metrics.json."""
    metrics = [Metric("error_m", 1.0, "m", high=2.0, reported="about 1 m"), Metric("far_m", 3.0, "m", decides=False)]
    outcome = Outcome([*metrics, Metric("step_ms_p95", 1.0, "ms")], Log(np.zeros(1)), lambda: None)
    document = metrics_document(outcome, {}, True)
    assert document["decides"] == {"error_m": True, "far_m": False, "step_ms_p95": False}
    assert document["reported"] == {"error_m": "about 1 m", "far_m": "", "step_ms_p95": ""}
