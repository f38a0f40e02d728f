"""Trials of faults: what they come to, and their table."""

import math
from pathlib import Path

from experiments.evidence.fault_run import run_trial
from experiments.evidence.fault_trials import SOON, TRIALS, fault_summary, faults_table, recorded_trial

from saphari_drake.simulation.faults.registry import FAULTS

CASE = TRIALS[0].name
DIAGRAMS = Path(__file__).parents[4] / "diagrams"


def trials(*reactions, speed=0.5, observable=1.0):
    """Return trials by seed as they are kept."""
    results = ({"start": 0.9, "observable": observable, "reaction": r, "speed_share": speed} for r in reactions)
    return {str(seed): recorded_trial(result) for seed, result in enumerate(results)}


def test_the_latest_answer_the_silent_seeds_and_the_fastest_joint_are_told():
    """A trial without an effect above the noise is neither told nor silent."""
    results = trials(0.02, 0.3, math.inf, 0.0)
    results["3"]["observable"], results["1"]["speed_share"] = None, 0.9
    expected = {"trials": 4, "acting": 3, "told": 2, "soon": 1, "reaction_max_s": 0.3, "silent_seeds": [2]}
    assert fault_summary(results) == {**expected, "speed_share_max": 0.9, "worst_seed": 1}


def test_the_table_says_what_is_silent_late_or_bounded():
    recorded = {
        "encoder_nan": {CASE: trials(0.02, 0.05, speed=0.9)},
        "camera_noise": {CASE: trials(math.inf)},
        "torque_bias": {CASE: trials(0.3)},
        "torque_noise": {CASE: trials(math.inf)},
        "torque_stuck": {CASE: trials(0.0, observable=math.inf)},
    }
    told = {line.split("`")[1]: line for line in faults_table(recorded).splitlines()[2:]}
    assert "50 ms (2 of 2)" in told["encoder_nan"] and f"0.90 ({CASE}, seed 0)" in told["encoder_nan"]
    assert "**no state published** (0 of 1)" in told["camera_noise"]
    assert "**300 ms** (1 of 1, 0 within 100 ms)" in told["torque_bias"]
    assert "bounded, joint speed ≤ 0.50 (1)" in told["torque_noise"]
    assert FAULTS["torque_noise"].bounded in told["torque_noise"]
    assert "no effect above the noise (1)" in told["torque_stuck"]
    assert faults_table({}).startswith("Not run yet")


def test_a_frozen_encoder_of_predictive_control_is_answered_in_time():
    """Seed 0 of the trials: joints within their limits all the while."""
    trial = next(trial for trial in TRIALS if trial.script == "nmpc_manipulator")
    became = run_trial(trial, "encoder_freeze", 0)
    assert trial.earliest < became["start"] < trial.latest
    assert became["reaction"] <= SOON and became["told"] < math.inf and became["speed_share"] <= 1.0
