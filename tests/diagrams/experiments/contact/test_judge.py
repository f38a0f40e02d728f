"""The judge is itself judged on logs whose answers are known."""

from dataclasses import replace

import numpy as np
import pytest
from experiments.contact import judge

from saphari_drake.errors import SensorError
from saphari_drake.messages import InteractionMode
from saphari_drake.robots.catalog import lwr4
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.log import Log

PUSH = Push("link_6", direction=[0.0, -1.0, 0.0], force=30.0, start=1.0, hold=1.0)
POINT = np.array([0.0, 0.072, 0.0])


@pytest.fixture(scope="module")
def robot():
    return lwr4()


def made_up_log(robot, force=(0.0, -30.0, 0.0), estimate=(0.0, -29.0, 0.5), settle=0.4):
    """A touch from 1.2 s to 2.0 s that turns joint 1 by 0.05 rad, and back within `settle` after it."""
    time = np.arange(0.0, 4.0, 0.005)
    touched = (time >= 1.2) & (time <= 2.0)
    q = np.tile(robot.home, (len(time), 1))
    back = np.clip(1.0 - (time - 2.0) / settle, 0.0, 1.0)
    q[:, 0] += 0.05 * np.where(time < 1.2, 0.0, np.where(time <= 2.0, np.clip((time - 1.2) / 0.3, 0.0, 1.0), back))
    points = np.array([robot.kinematics(row).position(5, POINT) for row in q])
    log = Log(time)
    log.add("position", q, "rad")
    truth = np.hstack([np.outer(touched, force), points * touched[:, None], np.where(touched, 5.0, -1.0)[:, None]])
    log.add("contact_truth", truth, "N, m, index")
    log.add("contact_force", np.outer(touched, estimate), "N")
    log.add("contact", ((time >= 1.21) & touched).astype(float), "1")
    log.add("mode", np.where((time >= 1.22) & touched, 1.0, 0.0), "mode")
    log.add("active_link", np.where((time >= 1.22) & touched, 5.0, -1.0), "index")
    log.add("contact_position", points + [0.004, 0.0, 0.003], "m")
    return log


def test_touch_is_found_with_link_and_point(robot):
    """First and last contact force, and the body-fixed point of the steady push."""
    log = made_up_log(robot)
    (touch,) = judge.find_touches(log, robot, [PUSH])
    assert log.time[touch.onset] == pytest.approx(1.2)
    assert log.time[touch.release] == pytest.approx(2.0)
    assert touch.link == 5
    np.testing.assert_allclose(touch.p_LC, POINT, atol=1e-9)


def test_a_hand_that_slips_off_is_judged_where_it_was(robot):
    """No contact any more at the end of the push: link and point are those of the last one."""
    log = made_up_log(robot)
    truth = log["contact_truth"].copy()
    truth[log.time > 1.6] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0]
    slipped = Log(log.time)
    slipped.add("position", log["position"], "rad")
    slipped.add("contact_truth", truth, "N, m, index")
    (touch,) = judge.find_touches(slipped, robot, [PUSH])
    assert touch.link == 5 and slipped.time[touch.release] == pytest.approx(1.6)
    np.testing.assert_allclose(touch.p_LC, POINT, atol=1e-9)


def test_errors_are_those_put_in(robot):
    """Force, localization, delay and link errors come out as they were made."""
    log = made_up_log(robot)
    (touch,) = judge.find_touches(log, robot, [PUSH])
    assert judge.force_error(log, touch) == pytest.approx(np.hypot(1.0, 0.5) / 30.0)
    found = judge.localized(log, touch)
    np.testing.assert_allclose(found.errors, 0.005)
    assert judge.detection_delay(log, touch) == pytest.approx(0.01)
    assert found.link_right == 1.0
    assert found.unanswered == pytest.approx(4 / 161)


def test_one_bad_touch_of_two_is_not_pooled_away(robot):
    """The worst touch counts, and the time in which a touch is not answered."""
    log = made_up_log(robot)
    second = judge.find_touches(log, robot, [PUSH])[0]
    first = replace(second, release=second.onset + 20)
    second = replace(second, onset=second.onset + 21)
    log["contact_position"][second.onset : second.release + 1] += [0.1, 0.0, 0.0]
    log["mode"][second.release - 13 : second.release + 1] = InteractionMode.YIELD
    values = {m.name: m for m in judge.localization_metrics(log, [first, second], 0.010, 0.015)}
    assert not values["localization_error_m"].met and values["localization_error_m"].value > 0.09
    assert not values["localization_error_p95_m"].met
    assert values["unanswered_share"].value == pytest.approx(4 / 21)
    alone = {m.name: m for m in judge.localization_metrics(log, [second], 0.010, 0.015)}
    assert alone["unanswered_share"].value == pytest.approx(14 / 140)


def test_touch_that_is_never_answered_counts_as_infinitely_wrong(robot):
    log = made_up_log(robot)
    (touch,) = judge.find_touches(log, robot, [PUSH])
    log["mode"][:] = InteractionMode.YIELD
    metrics = judge.localization_metrics(log, [touch], 0.010, 0.015)
    assert [m.met for m in metrics] == [False] * 4


def test_return_time_and_rest(robot):
    """A straight return in 0.4 s is within 2 % after 0.392 s, and nothing is left at the end."""
    log = made_up_log(robot, settle=0.4)
    (touch,) = judge.find_touches(log, robot, [PUSH])
    assert judge.return_time(log, robot, touch) == pytest.approx(0.39, abs=0.011)
    assert judge.position_error_final(log, robot, touch) < 1e-12


def test_a_return_that_never_ends_is_nan(robot):
    """NaN misses every bound."""
    log = made_up_log(robot, settle=50.0)
    (touch,) = judge.find_touches(log, robot, [PUSH])
    assert np.isnan(judge.return_time(log, robot, touch))


def test_deflection_error_is_zero_for_the_force_that_fits(robot):
    """F = K_p Δx gives zero."""
    (touch,) = judge.find_touches(log := made_up_log(robot), robot, [PUSH])
    moved = judge.deflection(log, robot, touch, judge.steady(log, touch)).mean(axis=0)
    fitting = made_up_log(robot, force=500.0 * moved)
    assert judge.deflection_error(fitting, robot, touch, np.full(3, 500.0)) < 1e-9
    doubled = made_up_log(robot, force=1000.0 * moved)
    assert judge.deflection_error(doubled, robot, touch, np.full(3, 500.0)) == pytest.approx(0.5)


def test_a_push_that_never_touched_is_said(robot):
    """The judge does not judge thin air."""
    log = made_up_log(robot)
    log["contact_truth"][:, :3] = 0.0
    with pytest.raises(SensorError, match="link_6 at 1 s never touched"):
        judge.find_touches(log, robot, [PUSH])


@pytest.mark.parametrize("mass", [3.0, 3.2, 10.0, 20.0])
def test_second_order_return_time_against_integration(mass):
    """The closed form equals a simulation of m ẍ + d ẋ + k x = 0, over- and underdamped, and at the double pole."""
    d, k, dt = 80.0, 500.0, 1e-5
    x, v, last = 1.0, 0.0, 0.0
    for i in range(400_000):
        v -= dt * (d * v + k * x) / mass
        x += dt * v
        if abs(x) > 0.02:
            last = (i + 1) * dt
    assert judge.second_order_return_time(mass, d, k) == pytest.approx(last, abs=3e-3)
