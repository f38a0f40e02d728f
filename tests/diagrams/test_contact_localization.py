"""The script of the contact localization: each kind of case runs, judges against the truth and writes its files."""

import json

import contact_localization as script
import numpy as np
import pytest
from experiments.localization.scenario import NEVER

from saphari_drake.simulation.runner.experiment import main
from saphari_drake.simulation.runner.simulation import RunOptions


def scenario_of(case, **values):
    scenario = script.scenario_for(case)
    for name, value in {"count": 3, "frames": 3, **values}.items():
        setattr(scenario, name, value)
    return scenario


@pytest.mark.parametrize("moving", [0.0, 1.0])
def test_visible_touch_is_found_beside_its_truth(moving):
    outcome = script.run(scenario_of("one_camera", moving=moving), RunOptions())
    assert outcome.log["other_link"].tolist() == [[-1.0]] * 3
    metrics = {metric.name: metric for metric in outcome.metrics}
    assert metrics["median_m"].met and np.isfinite(metrics["median_m"].high)
    values = {name: metric.value for name, metric in metrics.items()}
    assert values["median_m"] == pytest.approx(np.median(outcome.log["error"]))
    assert values["baseline_median_m"] == pytest.approx(np.median(outcome.log["baseline_error"]))


def test_two_contacts_have_a_row_each_and_files_are_written(tmp_path):
    arguments = ["--case", "two_contacts", "--set", "count=2", "--set", "frames=3", "--out", str(tmp_path)]
    status = main(script.EXPERIMENT, arguments)
    folder = tmp_path / "two_contacts"
    for name in ("metrics.json", "log.npz", "figure.png", "replay.html", "scenario.yaml"):
        assert (folder / name).stat().st_size > 0
    log = np.load(folder / "log.npz")
    assert len(log["link"]) == 4
    np.testing.assert_array_equal(log["link"][[0, 2]], log["other_link"][[1, 3]])
    document = json.loads((folder / "metrics.json").read_text())
    assert status == {"pass": 0, "fail": 1}[document["verdict"]]
    assert document["metrics"]["both_found"] == np.mean(log["error"] < NEVER)


def test_forces_of_a_range_are_judged_in_bands():
    outcome = script.run(scenario_of("force_range", count=6), RunOptions())
    force, found = outcome.log["force"][:, 0], outcome.log["error"][:, 0] < NEVER
    assert force.min() < 10.0 and force.max() > 40.0
    values = {metric.name: metric.value for metric in outcome.metrics}
    for low, high in ((3, 10), (10, 40), (40, 80)):
        rows = found & (force >= low) & (force < high)
        name = f"force_{low}_to_{high}_N_error_relative_median"
        assert (name in values) == rows.any()
        if rows.any():
            assert values[name] == pytest.approx(np.median(outcome.log["force_error"][rows]))


def test_same_seed_gives_the_same_scenes():
    runs = [script.run(scenario_of("hidden", count=2), RunOptions()) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].log["error"], runs[1].log["error"])


@pytest.mark.parametrize(
    "assignment", ["count=0", "frames=0", "moving=1.5", "moving=nan", "extrinsic_shift=-1", "cameras=[]"]
)
def test_bad_input_is_one_line_and_status_2(capsys, assignment):
    assert main(script.EXPERIMENT, ["--case", "one_camera", "--set", assignment]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and assignment.split("=")[0] in lines[0]
