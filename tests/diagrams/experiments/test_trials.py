"""Random trials: intervals of rates, and what one run tells of its trials."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from experiments.nmpc.jobs import clearance, point_positions
from experiments.nmpc.manipulator import manipulator_job
from experiments.priority.three_level import clearances
from experiments.priority.three_level_trials import draw_person
from experiments.sweep.plan import find_experiment
from experiments.trials import Panel, Shown, Trial, drawn_posture, interval, run_trials, share_metrics
from pydrake.common.yaml import yaml_dump_typed

from saphari_drake.errors import ParameterError
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.scenario import with_assignments
from saphari_drake.simulation.runner.simulation import RunOptions
from saphari_drake.simulation.view.figures import blank


@pytest.mark.parametrize("trials", [1, 7, 60, 1000])
def test_no_failure_bounds_the_rate_by_three_over_n(trials):
    assert interval(0, trials) == (0.0, min(3.0 / trials, 1.0))
    assert interval(trials, trials) == (1.0 - min(3.0 / trials, 1.0), 1.0)


@pytest.mark.parametrize(("rate", "trials"), [(0.5, 20), (0.9, 50), (0.97, 200)])
def test_the_interval_covers_the_true_rate_as_often_as_it_says(rate, trials):
    """95 % of the draws, within what 4000 draws tell (Wilson's interval is a little off for few trials)."""
    counts = np.random.default_rng(0).binomial(trials, rate, 4000)
    covered = np.mean([low <= rate <= high for low, high in (interval(int(k), trials) for k in counts)])
    assert 0.93 <= covered <= 0.99


def test_shares_come_with_their_interval():
    metrics = {m.name: m.value for m in share_metrics("met_share", [True] * 9 + [False])}
    assert metrics["met_share"] == 0.9
    assert metrics["met_share_from"] < 0.9 < metrics["met_share_to"] < 1.0


def run(tmp_path, trial=-1, trials=4):
    """Return the outcome of trials whose error is their number, met below 2, and what was run."""
    ran = []

    def one(number, label):
        ran.append(number)
        shown = Shown(Log([float(number)]), lambda: blank(1, 3, "alone")[0], lambda path: path.touch())
        return Trial(number, {"error": float(number)}, number < 2, f"error {number}", shown)

    numbers = [trial] if trial >= 0 else list(range(trials))
    scenario = SimpleNamespace(numbers=numbers, case="random", seed=7, trial=trial)

    def metrics(columns):
        return [Metric("error_max", columns["error"].max(), "m")]

    return run_trials(scenario, one, metrics, [Panel("error", 1.0, "error [m]", 2.0)], "title"), ran


def test_failing_trials_are_told_with_what_replays_them(tmp_path, capsys):
    outcome, ran = run(tmp_path)
    assert ran == [0, 1, 2, 3]
    assert {m.name: m.value for m in outcome.metrics} == {"error_max": 3.0, "trials": 4.0}
    lines = capsys.readouterr().out.splitlines()
    assert lines == [f"trial {k}: error {k} (--case random --seed 7 --set trial={k})" for k in (2, 3)]
    assert outcome.files["failures.txt"].splitlines() == lines
    np.testing.assert_array_equal(outcome.log["met"][:, 0], [1.0, 1.0, 0.0, 0.0])
    assert len(outcome.draw().axes) == 1


def test_a_trial_runs_alone(tmp_path):
    outcome, ran = run(tmp_path, trial=3)
    assert ran == [3] and {m.name: m.value for m in outcome.metrics}["trials"] == 1.0
    assert outcome.log.time == [3.0] and len(outcome.draw().axes) == 3  # its own


def test_postures_stay_within_the_limits(lwr4):
    rng = np.random.default_rng(0)
    q = np.array([drawn_posture(lwr4, 2.5, rng) for _ in range(200)])
    assert np.all((q >= lwr4.q_min) & (q <= lwr4.q_max)) and np.any(q == lwr4.q_max)
    near = np.array([drawn_posture(lwr4, 0.1, rng) for _ in range(50)])
    assert np.abs(near - lwr4.home).max() <= 0.1


@pytest.mark.parametrize(("name", "case"), [("contact_force", "compatible"), ("null_space_ball", "momentum"),
                                            ("skin_hand_guiding", "recorded")])  # fmt: skip
def test_other_cases_keep_what_is_theirs(name, case):
    """A scenario with trials has its own defaults, not those of the scenario of trials."""
    scenario = find_experiment(name).scenario_for(case)
    assert scenario.duration > 5.0 and len(scenario.home) == 7 and scenario.case == case
    with pytest.raises(ParameterError, match="trials"):
        type(scenario)(trials=0)


DRAWN = {
    "contact_force": lambda script, s, k: script.force_trial(s, k),
    "nmpc_manipulator": lambda script, s, k: script.manipulator_trial(s, k).job,
    "null_space_ball": lambda script, s, k: script.ball_trial(s, k),
    "skin_hand_guiding": lambda script, s, k: script.draw_guiding(s, script.scenario_for, k),
}


@pytest.mark.parametrize("name", DRAWN)
def test_a_trial_is_the_same_again_and_no_other(name):
    experiment = find_experiment(name)
    scenario = experiment.scenario_for("random")
    assert "random" not in experiment.seedless
    texts = [yaml_dump_typed(DRAWN[name](sys.modules[f"script_{name}"], scenario, k)) for k in (0, 1, 0)]
    assert texts[0] == texts[2] != texts[1]
    scenario.seed = 1
    assert yaml_dump_typed(DRAWN[name](sys.modules[f"script_{name}"], scenario, 0)) != texts[0]


def test_jobs_of_the_manipulator_can_be_done():
    """Start and goal keep the distance that is asked, with the room that was to be kept, inside the limits."""
    experiment = find_experiment("nmpc_manipulator")
    for number in range(3):
        scenario = sys.modules["script_nmpc_manipulator"].manipulator_trial(experiment.scenario_for("random"), number)
        job = manipulator_job(catalog.load("lwr4"), scenario.job)
        for degrees in (scenario.job.start_deg, scenario.job.goal_deg):
            q = np.deg2rad(degrees)
            places = point_positions(job.robot, job.points, evaluate_dynamics(job.robot, q, 0.0 * q))
            assert clearance(places, job.points, job.obstacles(0.0)) >= scenario.random.room - 1e-9
            assert np.all((q > job.robot.q_min) & (q < job.robot.q_max))


def test_people_start_clear_of_the_arm():
    experiment = find_experiment("reverse_priority_planar")
    scenario = experiment.scenario_for("random")
    for number in range(3):
        job = draw_person(scenario, number)
        assert clearances(job.robot, job.params, job.robot.home, job.person(0.0)).min() > job.params.clearance
        assert np.abs(job.robot.home - catalog.load("lwr4").home).max() > 0.05


class Columns(dict):
    """Columns of two trials, of any name."""

    def __missing__(self, name):
        return np.array([0.5, 1.0])


CONTRACT = {
    "contact_force": "force_norm_error_p95_N max_speed joint_speed_share_max wander_max_m",
    "nmpc_manipulator": "reached_share min_distance_margin_m limit_violations torque_excess_max step_ms_p99",
    "reverse_priority_planar": "hard_violations command_over_limit",
    "null_space_ball": "dwell_error_max_m unstable joint_speed_share_max",
    "skin_hand_guiding": "main_task_disturbance_p95 joint_speed_share_max",
}
METRICS = {
    "contact_force": lambda script: script.force_trial_metrics(Columns(), 0.25),
    "nmpc_manipulator": lambda script: script.manipulator_trial_metrics(Columns()),
    "reverse_priority_planar": lambda script: script.person_metrics(Columns()),
    "null_space_ball": lambda script: script.ball_metrics(Columns()),
    "skin_hand_guiding": lambda script: script.guiding_metrics(Columns()),
}


@pytest.mark.parametrize("name", CONTRACT)
def test_the_names_are_those_agreed(name):
    find_experiment(name)
    names = {metric.name for metric in METRICS[name](sys.modules[f"script_{name}"])}
    assert names >= {*CONTRACT[name].split(), "joint_speed_share_max", "torque_excess_max", "meets_all_share"}


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("nmpc_manipulator", ["duration=0.3"]),
        ("reverse_priority_planar", ["duration=0.2"]),
        ("null_space_ball", ["duration=1.2", *(f"system.cell.ball.{text}" for text in
                             ("start=0.05", "gap=0.005", "speed=0.2", "stroke=0.01", "dwell=0.6"))]),
    ],
)  # fmt: skip
def test_a_short_trial_runs_and_is_judged(name, settings):
    experiment = find_experiment(name)
    scenario = with_assignments(experiment.scenario_for("random"), ["trial=1", *settings])
    outcome = experiment.outcome(scenario, RunOptions())
    values = {metric.name: metric.value for metric in outcome.metrics}
    assert values["trials"] == 1.0 and 0.0 <= values["joint_speed_share_max"] < 1.5
    assert np.all(np.isfinite(list(values.values())))
    assert outcome.files["failures.txt"] or values["meets_all_share"] == 1.0
