"""The gate: what it lets pass, and the line it prints for what it does not."""

from datetime import date

import pytest
from evidence_runs import made
from experiments.evidence.gate import failures, gate_jobs, seed_of_the_day
from experiments.evidence.runs import Job, Run
from experiments.evidence.summary import summarize_case

GOOD = {"error": (0.10, None, 1.0, True), "extra": (5.0, None, None, True), "step_ms_p95": (1.0, None, 2.0, False)}


def recorded(metrics=GOOD):
    """Return results of two seeds that are 0.05 apart in `error`."""
    other = {**metrics, "error": (metrics["error"][0] + 0.05, *metrics["error"][1:])}
    return {"toy": {"a": summarize_case([made(metrics, 0), made(other, 1)], 0)}}


def changed(name, *row):
    return {**GOOD, name: row}


@pytest.mark.parametrize(
    "metrics",
    [
        GOOD,
        changed("error", 0.15, None, 1.0, True),
        changed("error", 0.06, None, 1.0, True),
        changed("extra", 5.09, None, None, True),
        changed("step_ms_p95", 900.0, None, 2.0, False),
        changed("step_ms_p95", None, None, None, False),
        changed("new", 1.0, None, None, True),
        {name: GOOD[name] for name in ("error", "extra")},
    ],
)
def test_a_figure_within_its_allowance_passes(metrics):
    """Timings move, come and go freely; so may a new metric without a bound come."""
    assert failures(made(metrics), recorded()) == []


@pytest.mark.parametrize(
    "metrics, words",
    [
        (changed("error", 0.151, None, 1.0, True), ["toy/a: error 0.151, recorded 0.1, allowed difference 0.05"]),
        (changed("error", 0.049, None, 1.0, True), ["toy/a: error 0.049, recorded 0.1"]),
        (changed("error", None, None, 1.0, True), ["toy/a: error no value, recorded 0.1"]),
        (changed("extra", 5.6, None, None, True), ["toy/a: extra 5.6, recorded 5, allowed difference 0.5"]),
        (changed("error", 0.1, None, 1.1, True), ["toy/a: error: bound ≤ 1.1, recorded ≤ 1"]),
        (changed("error", 0.1, None, None, True), ["toy/a: error: bound –, recorded ≤ 1"]),
        (changed("error", 0.1, None, 1.0, False), ["toy/a: error: decides the verdict or not, other than recorded"]),
        (changed("new", 0.1, 0.0, None, True), ["toy/a: new 0.1: has a bound and is not recorded"]),
        ({"error": GOOD["error"]}, ["toy/a: extra: recorded 5, not there any more"]),
    ],
)
def test_a_figure_off_its_recorded_value_fails(metrics, words):
    """One line a figure: it names script, case, metric, both values, the allowance and how to record anew."""
    lines = failures(made(metrics), recorded())
    assert len(lines) == 1
    assert all(word in lines[0] for word in words), lines
    assert lines[0].endswith("if that is meant, run report.py --only toy/a")


@pytest.mark.parametrize(("value", "passes"), [(2.9e-7, True), (9e-7, True), (3e-6, False)])
def test_what_no_sensor_tells_apart_is_no_difference(value, passes):
    """A remainder of 0.2 µm in one run and 0.9 µm in another is none in both."""
    tiny = {"error": (2e-7, None, None, True)}
    known = {"toy": {"a": summarize_case([made(tiny)], 0)}}
    lines = failures(made({"error": (value, None, None, True)}), known)
    assert (lines == []) == passes


def test_a_missing_value_that_was_missing_passes_and_one_that_appears_fails():
    never = changed("extra", None, None, None, True)
    assert failures(made(never), recorded(never)) == []
    assert len(failures(made(GOOD), recorded(never))) == 1


def test_a_missed_bound_fails_on_any_seed_and_is_named():
    """The seed of the day is judged by its bounds alone."""
    bad = {"error": (1.5, None, 1.0, True), "extra": (0.0, None, None, True), "soft": (3.0, None, 1.0, False)}
    assert failures(made(bad, 7, 1, given=7), {}) == ["toy/a seed 7: error 1.5 misses its bound ≤ 1"]
    lines = failures(made(changed("error", 1.5, None, 1.0, True), status=1), recorded())
    assert [line.split(";")[0] for line in lines] == [
        "toy/a: error 1.5 misses its bound ≤ 1",
        "toy/a: error 1.5, recorded 0.1, allowed difference 0.05",
    ]
    assert failures(made(GOOD, 7, given=7), {}) == []


@pytest.mark.parametrize("status", [2, -11, 130])
def test_a_run_that_breaks_fails_with_its_complaint(status):
    line = f"toy/a: exit status {status}: toy: error: no such arm"
    for document in ({}, made(GOOD).document):
        assert failures(Run(Job("toy", "a"), status, 1.0, document, "toy: error: no such arm"), recorded()) == [line]


def test_exit_status_1_fails_even_where_no_bound_is_missed():
    assert len(failures(made(GOOD, status=1), recorded())) == 1


def test_a_run_without_metrics_fails():
    assert len(failures(Run(Job("toy", "a"), 0, 1.0), recorded())) == 1


def test_a_case_that_is_not_recorded_fails():
    assert failures(made(GOOD), {}) == ["toy/a: not recorded; run report.py --only toy/a"]


def test_every_case_runs_once_and_the_main_ones_with_the_seed_of_the_day_too():
    """The longest run first, so that it does not end alone."""
    results = {"toy": {"a": {"seconds": 5}, "b": {"seconds": 50}}, "other": {"a": {"seconds": 20}}}
    jobs = gate_jobs([("toy", "a"), ("toy", "b"), ("other", "a")], 20260131, results, "toy")
    assert [job.name for job in jobs] == [
        "toy/b", "toy/b seed 20260131", "other/a", "toy/a", "toy/a seed 20260131",
    ]  # fmt: skip


def test_the_seed_of_the_day_is_the_date():
    assert seed_of_the_day(date(2026, 1, 31)) == 20260131


def test_a_bound_missed_on_the_realistic_plant_is_a_finding_but_its_figure_counts():
    metrics = changed("error_m", 0.7, None, 0.5, True)
    run = made(metrics, status=1)
    run = Run(Job("toy", "a/realistic"), 1, 1.0, run.document)
    same = {"toy": {"a/realistic": summarize_case([run], 0)}}
    assert failures(run, same) == []
    other = made(changed("error_m", 0.9, None, 0.5, True), status=1)
    (line,) = failures(Run(run.job, 1, 1.0, other.document), same)
    assert "error_m" in line and "recorded 0.7" in line
