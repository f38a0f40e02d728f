"""What a case's runs over seeds come to."""

import json
import math

import pytest
from evidence_runs import made
from experiments.evidence.results_file import dump, merge, read_results, rounded, write_results
from experiments.evidence.summary import allowed_difference, is_same, summarize_case, summarize_metric

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.runner.results import TIMING, Metric


def figures(values, low, high, default=0):
    seeds = dict(enumerate(values))
    return summarize_metric(seeds, default, dict.fromkeys(seeds, (low, high)))


@pytest.mark.parametrize(
    "values, low, high, worst, missed",
    [
        ([0.1, 0.3, 0.2], None, 1.0, 0.3, []),
        ([0.1, 0.3, 0.2], 0.0, None, 0.1, []),
        ([0.1, 1.3, 1.2], None, 1.0, 1.3, [1, 2]),
        ([0.1, 0.5, 0.8], 0.0, 1.0, 0.1, []),
        ([0.3, 0.5, 0.8], 0.0, 1.0, 0.8, []),
        ([-0.3, 0.5, 1.2], 0.0, 1.0, -0.3, [0, 2]),
        ([0.1, 0.3], None, None, None, []),
        ([0.1, None, 0.3], None, 1.0, None, [1]),
        ([0.1, None, 0.3], None, None, None, []),
        ([1.0, 1.0], None, 1.0, 1.0, []),
    ],
)
def test_worst_is_the_value_nearest_to_a_bound_or_farthest_beyond(values, low, high, worst, missed):
    """A seed without a value misses any bound, and is then the worst."""
    result = figures(values, low, high)
    assert result["worst"] == worst
    assert result["missed"] == missed


def test_median_spread_and_value_are_those_of_the_finite_values():
    result = figures([3.0, None, 1.0, 2.0], None, None, default=3)
    assert (result["value"], result["median"], result["min"], result["max"]) == (2.0, 2.0, 1.0, 3.0)
    assert result["spread"] == 2.0
    nothing = figures([None, None], None, 1.0)
    assert (nothing["value"], nothing["median"], nothing["spread"], nothing["missed"]) == (None, None, 0.0, [0, 1])


def test_bounds_are_those_of_each_seed():
    """A bound that follows from the run is missed by its own run alone."""
    result = summarize_metric({0: 1.0, 1: 2.0}, 0, {0: (None, 1.5), 1: (None, 2.5)})
    assert result["missed"] == []
    assert result["bound"] == [None, 1.5]


@pytest.mark.parametrize(
    "value, spread, bound, allowed",
    [
        (1.0, 0.5, (None, 2.0), 0.5),
        (1.0, 0.0, (None, 1.5), 0.05),
        (1.0, 0.0, (None, None), 0.10),
        (0.0, 0.0, (None, 5.0), 0.10),
        (0.0, 0.0, (-5.0, 1.0), 0.10),
        (3e-10, 0.0, (None, 1e-6), 2e-8),
        (None, 0.0, (None, None), 1e-6),
        (0.0, 0.0, (0.0, None), 1e-6),
    ],
)
def test_a_difference_is_allowed_for_spread_and_rounding(value, spread, bound, allowed):
    assert allowed_difference(value, spread, bound) == pytest.approx(allowed, rel=1e-12)


@pytest.mark.parametrize(
    "values, same",
    [([1.0], None), ([1.0, 1.0 + 1e-12], True), ([1.0, 1.001], False), ([None, 1.0], False), ([None, None], True)],
)
def test_a_seed_changes_nothing_where_all_values_are_the_same(values, same):
    assert is_same(dict(enumerate(values))) is same


def test_a_case_keeps_every_metric_of_any_seed_and_sets_timings_apart():
    runs = [
        made(
            {"late": (1.0, None, 2.0, False), "error": (0.3, None, 1.0, True), "step_ms_p95": (2.0, None, 1.0, False)},
            1,
        ),
        made({"error": (0.1, None, 1.0, True), "step_ms_p95": (9.0, None, 1.0, False)}, 0, status=1),
    ]
    summary = summarize_case(runs, 0)
    assert list(summary["metrics"]) == ["error", "late"]
    assert summary["metrics"]["error"]["value"] == 0.1 and summary["metrics"]["error"]["worst"] == 0.3
    assert summary["metrics"]["late"]["value"] is None and summary["metrics"]["late"]["missed"] == [0]
    assert summary["metrics"]["late"]["decides"] is False
    assert summary["metrics"]["error"]["reported"] == "error in the deliverable"
    assert summary["timings"]["step_ms_p95"]["value"] == 9.0
    assert summary["verdicts"] == {"0": "fail", "1": "pass"} and summary["seeds"] == [0, 1]


def test_a_case_without_its_default_seed_has_no_summary():
    with pytest.raises(KeyError):
        summarize_case([made({"error": (0.1, None, 1.0, True)}, 1)], 0)


@pytest.mark.parametrize("name", ["step_ms_p95", "cycle_ms", "real_time_factor", "real_time_factor_one_core"])
def test_timings_never_decide(name):
    assert TIMING.search(name) and not Metric(name, math.nan, high=1.0).decides


@pytest.mark.parametrize("name", ["time_msec", "speed_max_m_s", "rms_error_m", "my_real_time_factor"])
def test_other_names_are_no_timings(name):
    assert not TIMING.search(name)


def test_a_file_of_results_is_read_as_it_was_written(tmp_path):
    tree = {"toy": {"a": {"seeds": [0, 1], "metrics": {"e": {"value": 0.123456789, "worst": None, "whole": 3.0}}}}}
    write_results(tmp_path / "results.json", tree)
    read = read_results(tmp_path / "results.json")
    assert read["toy"]["a"]["metrics"]["e"] == {"value": 0.123457, "worst": None, "whole": 3}
    lines = (tmp_path / "results.json").read_text().splitlines()
    assert sum('"e": {"value": 0.123457' in line for line in lines) == 1, "a metric is a line"
    assert rounded(read) == read


def test_no_file_is_no_results_and_a_broken_one_is_named(tmp_path):
    assert read_results(tmp_path / "results.json") == {}
    (tmp_path / "results.json").write_text("{")
    with pytest.raises(ParameterError, match=r"results\.json"):
        read_results(tmp_path / "results.json")


def test_merging_keeps_the_order_of_the_scripts_and_drops_what_no_script_has():
    old = {"z": {"1": {"v": 1}}, "a": {"1": {"v": 1}, "2": {"v": 2}}, "gone": {"1": {"v": 0}}}
    merged = merge(old, {("a", "2"): {"v": 5}}, [("a", "1"), ("a", "2"), ("b", "1"), ("z", "1")])
    assert json.loads(dump(merged)) == {"a": {"1": {"v": 1}, "2": {"v": 5}}, "z": {"1": {"v": 1}}}
    assert list(merged) == ["a", "z"]


def test_a_case_that_a_seed_does_not_change_needs_one_run():
    """Its tables say "same on all seeds" as if all had been run."""
    run = made({"error": (0.3, None, 1.0, True)}, seed=4)
    assert summarize_case([run], 4)["metrics"]["error"]["same"] is None
    assert summarize_case([run], 4, seedless=True)["metrics"]["error"]["same"] is True
