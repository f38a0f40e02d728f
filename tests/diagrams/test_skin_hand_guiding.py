"""diagrams/skin_hand_guiding.py from the command line: bad input is one clear line and status 2; a short run."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from experiments.guiding.run import GuidingRecordingParameters, GuidingRuns
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.simulation.people.force_recording import read_force_recording
from saphari_drake.simulation.runner.experiment import main
from saphari_drake.simulation.runner.scenario import with_assignments

SCRIPT = Path(__file__).parents[2] / "diagrams" / "skin_hand_guiding.py"
CASES = ["end_effector_first", "body_first", "recorded", "random"]


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("skin_hand_guiding", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["skin_hand_guiding"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--case", "elbow_first"], ["elbow_first", "body_first"]),
        (["--set", "system.pipeline.controller.k_p=-1"], ["controller.k_p", "positive"]),
        (["--set", "system.pipeline.controler.k_p=1"], ["controler", "controller"]),
        (["--set", "system.interface=ethernet"], ["interface", "torque, position"]),
        (["--set", "system.skin_layout.curvature_radius=0.01"], ["curvature_radius", "0.02"]),
        (["--case", "recorded", "--set", "recording.file=nowhere.csv"], ["nowhere.csv"]),
        (["--case", "body_first", "--model", "missing.urdf"], ["missing.urdf"]),
        (["--seed", "-1"], ["seed"]),
    ],
)
def test_bad_input_is_one_line_and_status_2(script, capsys, arguments, words):
    """The line says what is wrong and what exists instead; there is no traceback."""
    assert main(script.EXPERIMENT, arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) in (1, len(CASES))
    for word in words:
        assert word in lines[0]


def test_cases_are_listed(script, capsys):
    assert main(script.EXPERIMENT, ["--list-cases"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == CASES


@pytest.mark.parametrize("case", CASES)
def test_scenarios_load_with_drake_s_own_loader(script, case):
    text = yaml_dump_typed(script.scenario_for(case))
    schema = type(script.scenario_for(case))
    assert yaml_dump_typed(yaml_load_typed(schema=schema, data=text)) == text


def test_the_diagram_is_drawn(script, tmp_path):
    path = tmp_path / "diagram.dot"
    assert main(script.EXPERIMENT, ["--case", "body_first", "--graphviz", str(path)]) == 0
    text = path.read_text()
    for name in ("skin_sensor", "skin_estimator", "force_sensor", "wrist_wrench", "controller", "hands"):
        assert name in text


def test_a_recording_is_scaled_centred_and_faded(script, tmp_path):
    """Its largest force is the peak, its mean zero, and it begins and ends at zero."""
    path = tmp_path / "force.csv"
    time = np.arange(0.0, 3.0, 0.01)
    force = np.column_stack([2.0 + np.sin(3 * time), np.cos(2 * time), 0 * time])
    np.savetxt(path, np.column_stack([time, force]), delimiter=",", header="time,fx,fy,fz", comments="")
    given = GuidingRecordingParameters(peak=6.0, start=1.0, longest=10.0)
    profile, end = given.profile(read_force_recording(path))
    assert end == pytest.approx(1.0 + time[-1])
    played = np.array([profile(1.0 + t) for t in time])
    assert np.linalg.norm(played, axis=1).max() <= 6.0 + 1e-9
    assert np.linalg.norm(played[50:-50], axis=1).max() > 4.5
    np.testing.assert_array_equal(profile(0.9), np.zeros(3))
    np.testing.assert_array_equal(profile(end + 0.1), np.zeros(3))


def test_a_short_run_is_judged(script):
    """Skin and priority within the bounds of the experiment on the first second of both hands."""
    changes = ["duration=2.6", "body.pulls=[]"]
    scenario = with_assignments(script.scenario_for("end_effector_first"), changes)
    scenario.body.pulls = [script.Pull(1.2, 1.2, 0.4, [1.0, 1.0, -5.0])]
    runs = GuidingRuns(scenario, script.SYNTHETIC)
    result, alone = runs.get(), runs.get(0.0)
    metrics = {metric.name: metric for metric in script.judged(result, alone, runs.get(script.STRONGER))}
    bounded = {name for name, metric in metrics.items() if np.isfinite(metric.low) or np.isfinite(metric.high)}
    assert bounded >= {"main_task_disturbance", "skin_force_error_relative", "skin_point_error_m", "skin_missed_share"}
    assert [name for name in bounded if metrics[name].decides and not metrics[name].met] == []
    assert metrics["skin_touches"].value == 1
    assert len(result.fast.time) == 2601
    assert script.limits(result, runs.get(script.STRONGER))[0].met
    figure = script.forces_and_velocities(result, alone, "title")
    assert len(figure.axes) == 4
