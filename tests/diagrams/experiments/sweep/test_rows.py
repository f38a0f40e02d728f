"""Tables of a sweep: the same file from the same rows in any order, and what they come to."""

import pytest
from experiments.sweep.plan import Plan
from experiments.sweep.rows import Journal, summarize, write_tables
from experiments.sweep.worker import Row

from saphari_drake.errors import ParameterError

PLAN = Plan("x", "random")
BOUNDS = {"gap": [0.0, float("inf")], "speed": [float("-inf"), 1.0]}
ROWS = [
    Row(k, {"trial": k, "met": k != 2, "error": "", "gap": 0.1 * k, "speed": 0.2 * k}, {"seconds": 1.0 + k}, BOUNDS)
    for k in range(5)
]


def test_the_order_in_which_rows_come_changes_nothing(tmp_path):
    pytest.importorskip("pyarrow", reason="the extra sweep is not installed")
    files = []
    for name, rows in (("a", ROWS), ("b", ROWS[::-1])):
        journal = Journal(tmp_path / name, PLAN)
        for row in rows:
            journal.add(row)
        write_tables(journal)
        files.append((tmp_path / name / "trials.parquet").read_bytes())
    assert files[0] == files[1]


def test_the_worst_is_towards_the_bound_that_there_is():
    summary = summarize(PLAN, [row.values for row in ROWS], BOUNDS)
    assert (summary["met"], summary["trials"], summary["failing"]) == (4, 5, [2])
    assert summary["metrics"]["gap"]["worst"] == 0.0 and summary["metrics"]["gap"]["worst_trial"] == 0
    assert summary["metrics"]["speed"]["worst"] == 0.8 and summary["metrics"]["speed"]["worst_trial"] == 4
    rate, low, high = summary["rate"]
    assert low < rate == 0.8 < high


def test_a_folder_holds_one_sweep(tmp_path):
    Journal(tmp_path, PLAN)
    with pytest.raises(ParameterError, match="another sweep"):
        Journal(tmp_path, Plan("x", "random", seed=1))
