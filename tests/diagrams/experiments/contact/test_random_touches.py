"""Random touches: drawn alike everywhere, only the finger touches, nothing that failed is left out."""

import importlib.util
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from experiments.contact import random_judge
from experiments.contact.random_run import trial_of
from experiments.contact.random_touches import RandomTouchParameters, draw_touch

from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.pushing_hand import find_target
from saphari_drake.simulation.runner.experiment import main
from saphari_drake.simulation.world.hand import HandParameters

DIAGRAMS = Path(__file__).parents[4] / "diagrams"
HAND = HandParameters()
CONTRACT = (
    "meets_all_share", "meets_all_share_seen", "joint_speed_share_max", "wander_max_m", "detection_delay_p95_s",
    "trials",
)  # fmt: skip


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("contact_impedance", DIAGRAMS / "contact_impedance.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["contact_impedance"] = module
    spec.loader.exec_module(module)
    return module


# ---- drawing -------------------------------------------------------------------------------------------------------


def test_a_seed_gives_the_same_touch_and_another_one_another(lwr4):
    a, b, c = (draw_touch(lwr4, HAND, RandomTouchParameters(), seed) for seed in ([3, 1], [3, 1], [3, 2]))
    np.testing.assert_array_equal(a.q, b.q)
    assert a.push == b.push and a.finger_radius == b.finger_radius
    assert a.push != c.push


def test_touches_stay_within_their_ranges_and_cover_them(lwr4):
    """Posture, link, force, finger and angle to the normal, from outside, over many draws."""
    params = RandomTouchParameters()
    drawn = [draw_touch(lwr4, HAND, params, [7, k]) for k in range(40)]
    assert {t.push.link for t in drawn} == set(params.links)
    force, radius = (np.array(values) for values in zip(*((t.push.force, t.finger_radius) for t in drawn)))
    assert 12.0 <= force.min() < 16.0 and 31.0 < force.max() <= 35.0
    assert 0.009 <= radius.min() < 0.011 and 0.016 < radius.max() <= 0.018
    for touch in drawn:
        assert np.abs(touch.q - lwr4.home).max() <= np.deg2rad(40.0) + 1e-9
        assert np.minimum(touch.q - lwr4.q_min, lwr4.q_max - touch.q).min() >= np.deg2rad(5.0) - 1e-9
        n_W = surface_of(lwr4, touch)[1]
        assert -n_W @ touch.push.direction >= np.cos(np.deg2rad(45.0)) - 1e-6, touch.push.link


def test_every_touch_can_be_run(lwr4, script):
    """The robot that a trial loads stands as the one that it was drawn for, to the last digit: the push meets its link.

    A push that passes another link by a hair's breadth met it in a posture that was rounded.
    """
    for trial in range(60):
        _, drawn, single = trial_of(script.scenario_for("random"), trial)
        robot = catalog.load(single.robot, home=np.deg2rad(single.home))
        np.testing.assert_array_equal(robot.home, drawn.q)
        find_target(robot, robot.home, drawn.push)


def surface_of(robot, touch):
    terms, s = evaluate_dynamics(robot, touch.q, np.zeros(robot.n)), robot.shapes
    link = robot.link_index(touch.push.link)
    R_WS, p_WS = s.in_world(terms.R_WL, terms.p_WL)
    aim = terms.p_WL[link] + terms.R_WL[link] @ np.array(touch.push.aim)
    return nearest_surface_point(s.kind, s.size, R_WS, p_WS, s.link == link, aim)[2:]


def test_only_the_finger_touches(lwr4):
    """Fist and forearm keep clear of robot and floor when the fingertip is at the surface."""
    s = lwr4.shapes
    for k in range(20):
        touch = draw_touch(lwr4, HAND, RandomTouchParameters(), [11, k])
        p_W, n_W = surface_of(lwr4, touch)
        terms = evaluate_dynamics(lwr4, touch.q, np.zeros(7))
        R_WS, p_WS = s.in_world(terms.R_WL, terms.p_WL)
        back = -np.array(touch.push.direction)
        start = HAND.finger_length + 0.7 * HAND.fist_radius
        for along, radius in [(start, HAND.fist_radius), (start + HAND.forearm_length, HAND.forearm_radius)]:
            centre = p_W + touch.finger_radius * n_W + along * back
            gap = nearest_surface_point(s.kind, s.size, R_WS, p_WS, np.ones(s.count, bool), centre)[1] - radius
            assert gap > 0.015 and centre[2] > radius


@pytest.mark.parametrize(("name", "value"), [("force", [5.0]), ("finger_radius", [0.02, 0.01]), ("links", [])])
def test_bad_ranges_are_named(name, value):
    with pytest.raises(ParameterError) as error:
        RandomTouchParameters(**{name: value})
    assert error.value.field == name


# ---- judging -------------------------------------------------------------------------------------------------------


def judged(**values):
    fine = dict(
        trial=0, link=4, force=20.0, finger_radius=0.01, seen=1.0, force_error=0.02, deflection_error=0.03,
        point_error=0.003, unanswered=0.01, return_error=0.001, delay=0.01, speed_share=0.4, wander=0.001,
        torque_excess=0.0,
    )  # fmt: skip
    return random_judge.JudgedTouch(**{**fine, **values})


@pytest.mark.parametrize("name", ["force_error", "deflection_error", "point_error", "return_error"])
def test_a_touch_has_to_meet_everything(name):
    assert judged().meets_all
    assert not judged(**{name: 1.0}).meets_all


def test_a_hidden_touch_may_be_off_by_twice_as_much():
    assert not judged(point_error=0.015).meets_all
    assert judged(point_error=0.015, seen=0.0).meets_all
    assert not judged(point_error=0.021, seen=0.0).meets_all


def test_failures_count_in_every_share_and_can_be_replayed(lwr4):
    """A touch that was never answered lowers all shares and is printed with the option that runs it alone."""
    lost = judged(trial=7, seen=0.0, force_error=1.0, deflection_error=1.0, point_error=1.0, unanswered=1.0, wander=0.3)
    values = {m.name: m.value for m in random_judge.random_metrics([judged(), judged(trial=1), judged(trial=2), lost])}
    assert values["meets_all_share"] == 0.75 and values["meets_all_share_seen"] == 1.0
    assert values["meets_all_share_hidden"] == 0.0
    assert values["unanswered_share_max"] == 1.0 and values["wander_max_m"] == 0.3
    text = random_judge.failures(lwr4, [judged(), lost], SimpleNamespace(case="random", seed=5))
    assert text.count("\n") == 0 and "--seed 5 --set trial=7" in text


def test_one_touch_runs_alone_and_writes_the_contract_s_metrics(script, tmp_path, capsys):
    arguments = ["--case", "random", "--set", "trial=0", "--set", "system.camera.renderer=raycast"]
    assert main(script.EXPERIMENT, [*arguments, "--out", str(tmp_path)]) == 0, capsys.readouterr().out
    folder = tmp_path / "random"
    metrics = json.loads((folder / "metrics.json").read_text())["metrics"]
    assert set(CONTRACT) <= set(metrics) and metrics["trials"] == 1
    for name in ("log.npz", "figure.png", "replay.html", "scenario.yaml"):
        assert (folder / name).stat().st_size > 0


# ---- the scripted pushes -------------------------------------------------------------------------------------------


def test_three_natural_pushes_meet_the_script_s_own_bounds(script, capsys):
    """The main experiment as it is run from the command line."""
    assert main(script.EXPERIMENT, ["--case", "natural"]) == 0, capsys.readouterr().out
