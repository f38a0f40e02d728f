"""Trials of faults: what they come to, and their table."""

from experiments.evidence.fault_trials import TRIALS, fault_jobs, fault_summary, faults_table
from experiments.evidence.runs import Job, Run

from saphari_drake.simulation.faults.registry import FAULTS

SCRIPT, CASE, _ = TRIALS[0]


def run(seed, reaction, speed=0.5):
    metrics = {"fault_reaction_s": reaction, "joint_speed_share_max": speed}
    return Run(Job(SCRIPT, CASE, seed, "encoder_nan"), 0, 1.0, {"metrics": metrics})


def test_every_fault_is_tried_on_every_case_with_every_seed():
    jobs = fault_jobs([0, 1], [])
    assert len(jobs) == len({job.name for job in jobs}) == len(FAULTS) * len(TRIALS) * 2
    assert jobs[0].options[:2] == ("--set", f"faults=[{jobs[0].label}]")


def test_the_latest_answer_and_the_fastest_joint_are_told():
    """A fault that nobody answers has no reaction; one of a part that a case does not have is no trial."""
    summary = fault_summary([run(0, 0.02), run(1, 0.3, 0.9), run(2, None)])
    expected = {"trials": 3, "made": 3, "answered": 2, "soon": 1, "reaction_max_s": 0.3}
    assert summary == {**expected, "speed_share_max": 0.9, "worst_seed": 1}
    no_part = Run(Job(SCRIPT, CASE, 0, "skin_lost"), 2, 1.0, {}, "error: fault 'skin_lost': acts on skin")
    assert fault_summary([no_part]) == {}
    broken = Run(Job(SCRIPT, CASE, 0, "encoder_nan"), 2, 1.0, {}, "error: the push never touched")
    assert fault_summary([broken])["made"] == 0


def test_the_table_says_what_is_silent():
    name = f"{SCRIPT}/{CASE}"
    recorded = {
        "encoder_nan": {name: fault_summary([run(0, 0.02), run(1, 0.3, 0.9)])},
        "camera_noise": {name: fault_summary([run(0, None)])},
    }
    lines = faults_table(recorded).splitlines()
    assert len(lines) == 4
    assert "no state published (0 of 1)" in lines[2]
    assert "300 ms (2 of 2)" in lines[3] and f"0.90 ({name}, seed 1)" in lines[3]
    assert faults_table({}).startswith("Not run yet")
