"""The scripts of Section 5: short runs with figure and metrics, scenarios as files, bad input."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from experiments.null_space.run import CASES, aimed
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.simulation.runner.experiment import main
from saphari_drake.simulation.runner.simulation import RunOptions

FOLDER = Path(__file__).parents[2] / "diagrams"
NAMES = ("null_space_ball", "null_space_wall", "null_space_robustness")


def load(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def scripts():
    return {name: load(name) for name in NAMES}


def short(scenario):
    """Shorten a scenario to a touch."""
    ball = scenario.system.cell.ball
    ball.start, ball.gap, ball.stroke, ball.dwell = 0.05, 0.002, 0.005, 0.5
    scenario.system.cell.wall.gap = 0.001
    scenario.motion.start, scenario.motion.travel_time, scenario.motion.displacement = 0.0, 0.7, [0.0, 0.08, 0.0]
    scenario.duration = 0.72
    return scenario


@pytest.mark.parametrize("name, metric", [(NAMES[0], "dwell_error_m"), (NAMES[1], "tracking_error_max_m")])
def test_short_run_judges_every_case_and_draws(scripts, name, metric):
    """Metrics are finite, the figure shows all cases, and the case without observer errs most."""
    script, errors = scripts[name], {}
    for case in CASES if name == "null_space_ball" else ("none", "momentum"):
        outcome = script.run(short(script.scenario_for(case)), RunOptions())
        values = {m.name: m.value for m in outcome.metrics}
        assert np.all(np.isfinite(list(values.values())))
        run = script.RUNS.get(short(script.scenario_for(case)))
        assert len(run.fast.time) == 721  # every step of the plant
        fastest = np.abs(run.fast["velocity"] / run.setup.robot.v_max).max()
        assert values["joint_speed_share_max"] == pytest.approx(fastest) and fastest > 0.0
        assert values["torque_excess_max"] == 0.0
        errors[case] = values[metric]
    assert max(errors, key=errors.get) == "none"
    text = {label.get_text() for ax in outcome.draw().axes for label in ax.get_legend().get_texts()}
    assert text >= set(CASES)


@pytest.mark.parametrize("name", NAMES[:2])
def test_the_experiment_meets_its_bounds(scripts, name, capsys):
    """The whole contact, with the observer from the momentum: the script itself says that it passes."""
    assert main(scripts[name].EXPERIMENT, ["--case", "momentum"]) == 0, capsys.readouterr().out


def test_short_run_with_friction_and_payload(scripts):
    """All conditions are told apart; before the contact the observer has taken up the payload's weight."""
    outcome = scripts["null_space_robustness"].run(
        short(scripts["null_space_robustness"].scenario_for("momentum")), RunOptions()
    )
    values = {m.name: m.value for m in outcome.metrics}
    assert np.all(np.isfinite(list(values.values())))
    assert values["exact_dwell_absorbed_N"] < 0.5 < values["payload_dwell_absorbed_N"]
    assert 0.0 < values["joint_speed_share_max"] < 1.0 and values["torque_excess_max"] == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_scenarios_load_with_drake_s_own_loader(scripts, name):
    scenario = scripts[name].scenario_for("momentum")
    text = yaml_dump_typed(scenario)
    assert yaml_dump_typed(yaml_load_typed(schema=type(scenario), data=text)) == text


def test_seed_changes_where_and_whence(scripts):
    """Seeds differ in point and direction, by no more than the scenario says; a seed gives the same each time."""
    script, seen = scripts["null_space_ball"], []
    for seed in (0, 1, 1):
        scenario = script.scenario_for("momentum")
        scenario.seed = seed
        cell = aimed(scenario).cell
        seen.append([*cell.ball.touch.aim, *cell.ball.touch.direction])
        direction = np.array(cell.ball.touch.direction) / np.linalg.norm(cell.ball.touch.direction)
        assert direction @ [0.0, -1.0, 0.0] >= np.cos(np.deg2rad(scenario.direction_spread))
        assert abs(cell.ball.touch.aim[2] - scenario.system.cell.ball.touch.aim[2]) <= scenario.aim_spread
        assert cell.wall.touch.direction == cell.ball.touch.direction
    assert seen[0] != seen[1] and seen[1] == seen[2]


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--case", "ideal"], ["ideal", "task_error_pd"]),
        (["--case", "task_error_pd", "--set", "system.controller.gamma=7"], ["gamma", "must be below"]),
        (["--case", "none", "--set", "system.controller.period=0.004"], ["controller.period", "set period"]),
        (["--case", "none", "--set", "system.cell.ball.touch.link=nose"], ["nose", "link_3"]),
    ],
)
def test_bad_input_is_one_line_and_status_2(scripts, capsys, arguments, words):
    assert (
        main(scripts["null_space_ball"].EXPERIMENT, ["--case", "none", *arguments][2 * ("--case" in arguments) :]) == 2
    )
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    for word in words:
        assert word in lines[0]
