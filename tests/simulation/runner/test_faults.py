"""Metrics of a run with faults, and what a script says of faults that it cannot have."""

import importlib

import numpy as np
import pytest

from saphari_drake.simulation.faults.watch import Answer
from saphari_drake.simulation.runner.experiment import main
from saphari_drake.simulation.runner.faults import fault_metrics
from saphari_drake.simulation.runner.plant_scenario import PlantScenario


@pytest.mark.parametrize(
    ("told", "reaction", "silent"),
    [
        ([(1.54, 1.5), (1.51, 1.5)], 0.04, 0.0),
        ([(1.54, 1.5), (np.inf, 1.5)], np.inf, 1.0),
        ([(1.74, 1.7), (np.inf, np.inf), (1.5, 1.6)], 0.04, 0.0),
    ],
)
def test_reaction_is_that_of_the_slowest_run_from_the_first_effect(told, reaction, silent):
    """A run in which the fault had no effect is not silent."""
    answers = [Answer(time, observable, 0.5) for time, observable in told]
    metrics = {m.name: m for m in fault_metrics(PlantScenario(faults=["torque_bias"], fault_time=1.5), answers)}
    assert metrics["fault_time_s"].value == 1.5
    assert metrics["fault_reaction_s"].value == pytest.approx(reaction)
    assert metrics["silent_faults"].value == silent
    assert not any(m.decides for name, m in metrics.items() if name != "fault_time_s")


def test_a_script_lists_what_it_can_have(capsys):
    experiment = importlib.import_module("null_space_ball").EXPERIMENT
    for name, words in (("camera_freeze", "no fault here"), ("rust", "no fault 'rust'")):
        assert main(experiment, ["--case", "none", "--set", f"faults=[{name}]"]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1 and words in told and "encoder_nan" in told and "skin_lost" not in told


def test_a_run_tells_plant_faults_and_reaction(capsys):
    """The person's arm of the LWR4: a dead encoder is answered in its own cycle."""
    experiment = importlib.import_module("reverse_priority_planar").EXPERIMENT
    options = ["--case", "three_level", "--duration", "0.3", "--plant", "realistic", "--set", "faults=[encoder_nan]"]
    main(experiment, [*options, "--set", "fault_time=0.2"])
    told = capsys.readouterr().out
    assert "plant: realistic" in told and "faults: encoder_nan" in told
    row = next(line.split() for line in told.splitlines() if line.startswith("fault_reaction_s"))
    assert float(row[1]) < 0.01
