"""The page of hazards: as recorded, with tests that exist and every fault in a row."""

from pathlib import Path

import pytest
from experiments.evidence.fault_trials import TRIALS
from experiments.evidence.hazards import HAZARDS, hazards_text
from experiments.evidence.results_file import read_results

from saphari_drake.simulation.faults.registry import FAULTS

ROOT = Path(__file__).parents[4]


def test_the_page_is_what_is_recorded():
    recorded = read_results(ROOT / "diagrams" / "faults.json")
    assert hazards_text(recorded) == (ROOT / "diagrams" / "hazards.md").read_text(encoding="utf-8")


def test_every_fault_has_its_hazard():
    assert sorted(fault for row in HAZARDS for fault in row.faults) == sorted(FAULTS)


@pytest.mark.parametrize("test", sorted({test for row in HAZARDS for test in row.tests}))
def test_the_tests_that_are_named_exist(test):
    assert (ROOT / test).is_file()


def test_silent_late_and_bounded_faults_are_told():
    told = {"start": 0.9, "observable": 1.0, "reaction": 0.02, "speed_share": 0.5}
    entry = {"0": told, "1": {**told, "reaction": None}}
    text = hazards_text({"torque_bias": {TRIALS[0].name: entry}, "torque_noise": {TRIALS[0].name: entry}})
    row = next(line for line in text.splitlines() if "another torque" in line)
    assert f"silent: {TRIALS[0].name} torque_bias" in row and "bounded, not told: torque_noise" in row
    assert "0.50" in row and "20 ms" in row
