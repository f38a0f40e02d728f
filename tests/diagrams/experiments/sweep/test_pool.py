"""Rows are the same wherever they ran, and a process that dies is a row."""

import json

import pytest
from experiments.sweep.command import main
from experiments.sweep.plan import Plan
from experiments.sweep.pool import run_local, run_ray
from experiments.sweep.worker import Task, run_task

PLAN = Plan("reverse_priority_planar", "unconstrained", vary={"duration": {"uniform": [0.05, 0.1]}})
TASKS = [Task(k, k, PLAN.drawn(k)) for k in range(3)]


@pytest.fixture(scope="module")
def rows():
    return told(run_task(PLAN, task) for task in TASKS)


def told(rows):
    """Return rows as text, in which a value that is not a number equals itself."""
    return {row.row: json.dumps(row.values) for row in rows}


def test_processes_that_are_replaced_give_the_same_rows(rows):
    found = list(run_local(PLAN, TASKS, workers=2, recycle=1))
    assert told(found) == rows
    assert all(not row.values["error"] and row.times["seconds"] > 0.0 for row in found)


def test_a_cluster_gives_the_same_rows(rows):
    pytest.importorskip("ray", reason="the extra ray is not installed")
    assert told(run_ray(PLAN, TASKS, "local", workers=2)) == rows


def test_an_error_of_a_trial_is_its_result():
    row = run_task(PLAN, Task(4, 0, {"duration": -1.0}))
    assert not row.values["met"] and "simulator" in row.values["error"]


def test_a_process_that_dies_is_a_row_and_the_next_trial_runs_in_another():
    (row,) = run_local(Plan("no_such_script", "random"), TASKS[:1], workers=1)
    assert not row.values["met"] and "the process died, exit status 1" in row.values["error"]


def test_the_command_sweeps_goes_on_and_replays(tmp_path, capsys):
    """An interrupted sweep goes on where it was; a row that is run again is what it was."""
    pytest.importorskip("pyarrow", reason="the extra sweep is not installed")
    common = ["reverse_priority_planar", "--case", "unconstrained", "--set", "duration=0.05", "--workers", "1"]

    def run(*more):
        return main([*common, "--out", str(tmp_path), *more])

    journal = tmp_path / "journal.jsonl"
    assert run("--trials", "1") == 0
    before = journal.read_text()
    with journal.open("a") as file:
        file.write('[1, {"cut o')
    assert run("--trials", "2") == 0
    assert "1 trials are there already" in capsys.readouterr().out
    assert journal.read_text().startswith(before)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["trials"] == 2 and "joint_speed_share_max" in summary["metrics"]
    assert run("--replay", "0") == 0 and (tmp_path / "replays" / "0" / "metrics.json").is_file()
    assert run("--trials", "2", "--seed", "9") == 2 and "another sweep" in capsys.readouterr().err
