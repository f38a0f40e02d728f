"""The search finds the worst of a metric, and goes on from a journal with the same points."""

import pytest
from experiments.sweep.plan import Plan
from experiments.sweep.rows import Journal
from experiments.sweep.search import cost, search
from experiments.sweep.worker import Row

from saphari_drake.errors import ParameterError, UnknownNameError

PLAN = Plan("x", "random", vary={"a": {"uniform": [-2.0, 2.0]}, "b": {"uniform": [0.0, 4.0]}})
OPEN = [float("-inf"), float("inf")]


def hill(task):
    """A metric whose largest value, 3, is at (1.5, 0.5)."""
    value = 3.0 - (task.values["a"] - 1.5) ** 2 - (task.values["b"] - 0.5) ** 2
    return Row(task.row, {"trial": 0, "met": True, "error": "", **task.values, "hill": value}, {}, {"hill": OPEN})


def found(folder, trials, metric="hill"):
    journal, fresh = Journal(folder, PLAN), []
    search(PLAN, metric, trials, 0, journal, lambda tasks: (hill(task) for task in tasks), fresh.append)
    return journal, fresh


def test_it_finds_the_worst_and_goes_on_where_it_was(tmp_path):
    pytest.importorskip("cma", reason="the extra sweep is not installed")
    whole, _ = found(tmp_path / "whole", 120)
    assert max(row.values["hill"] for row in whole.rows()) > 3.0 - 1e-3
    found(tmp_path / "parts", 30)
    parts, fresh = found(tmp_path / "parts", 120)
    assert fresh[0].row >= 30 and parts.rows() == whole.rows()


def test_what_cannot_be_searched_is_told(tmp_path):
    pytest.importorskip("cma", reason="the extra sweep is not installed")
    with pytest.raises(UnknownNameError, match="hill"):
        found(tmp_path / "name", 30, "valley")
    with pytest.raises(ParameterError, match="vary"):
        search(Plan("x", "random"), "hill", 9, 0, Journal(tmp_path / "none", Plan("x", "random")), None, None)


@pytest.mark.parametrize(("bound", "sign"), [(OPEN, -1.0), ([0.0, float("inf")], 1.0), ([float("-inf"), 1.0], -1.0)])
def test_worse_is_smaller_where_there_is_a_lower_bound_alone(bound, sign):
    assert cost(Row(0, {"m": 2.0}, {}, {"m": bound}), "m") == sign * 2.0
    assert cost(Row(0, {"m": float("nan")}, {}, {"m": bound}), "m") > 1e6
