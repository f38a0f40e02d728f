"""Where a seed is said to change nothing it changes nothing; elsewhere it does. Every script tells of the limits."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from experiments.guiding.run import build

from saphari_drake.robots import catalog
from saphari_drake.simulation.runner.simulation import RunOptions

DIAGRAMS = Path(__file__).parents[1] / "diagrams"
CLOCK = ("_ms_", "real_time_factor")  # in names of metrics that no run repeats
SHORT = {"nmpc_manipulator": 0.3, "nmpc_mobile_manipulator": 0.2, "reverse_priority_planar": 0.5}
SEEDED = {"nmpc_mobile_manipulator": {"human_seen", "human_random"}, "reverse_priority_planar": {"three_level"}}


def load(name):
    spec = importlib.util.spec_from_file_location(name, DIAGRAMS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def numbers(script, case, seed, duration):
    """What a short run of a seed gives: its motion, and its metrics but for the clock."""
    scenario = script.scenario_for(case)
    scenario.seed, scenario.duration = seed, duration
    if case.startswith("human"):
        scenario.job.cell.watch.camera.renderer = "raycast"
    outcome = script.run(scenario, RunOptions())
    values = {m.name: m.value for m in outcome.metrics}
    fastest = np.abs(outcome.log["velocity"] / catalog.load(scenario.robot).v_max).max()
    assert values["joint_speed_share_max"] == pytest.approx(fastest)
    assert ("torque_excess_max" in values) == ("torque_excess" in outcome.log)
    metrics = [value for name, value in values.items() if not any(part in name for part in CLOCK)]
    return np.concatenate([outcome.log["position"].ravel(), outcome.log["velocity"].ravel(), metrics])


@pytest.mark.parametrize("name", SHORT)
def test_a_seed_changes_what_is_said(name):
    script = load(name)
    for case in [case for case in script.CASES if case != "random"]:
        first, second = (numbers(script, case, seed, SHORT[name]) for seed in (0, 1))
        seedless = case in script.EXPERIMENT.seedless
        assert np.array_equal(first, second, equal_nan=True) == seedless, case
        assert seedless == (case not in SEEDED.get(name, set()))


@pytest.mark.parametrize("case", ["end_effector_first", "body_first", "recorded"])
def test_a_seed_changes_the_hands(case):
    script = load("skin_hand_guiding")
    assert case not in script.EXPERIMENT.seedless
    grips = []
    for seed in (0, 1):
        scenario = script.scenario_for(case)
        scenario.seed = seed
        grips.append(build(scenario, script.SYNTHETIC).grips[1])
    assert not np.array_equal(grips[0].p_LC, grips[1].p_LC)


@pytest.mark.parametrize("name", ["null_space_ball", "null_space_wall", "null_space_robustness"])
def test_where_obstacles_are_aimed_at_by_the_seed_no_case_is_seedless(name):
    assert not load(name).EXPERIMENT.seedless
