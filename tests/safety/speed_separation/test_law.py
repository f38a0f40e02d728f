"""The protective separation distance against the formula of the standard, and the speed that keeps it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saphari_drake.safety.nearness import Balls, fastest_end, pair, posed, surface_of, towards
from saphari_drake.safety.speed_separation.law import (
    interpolated,
    permitted_scale,
    person_way,
    protective_distance,
)
from saphari_drake.safety.speed_separation.parameters import SpeedSeparationParameters

TABLE = np.array([0.0, 1.0, 2.0]), np.array([0.02, 0.12, 0.20]), np.array([0.0, 0.07, 0.2])


def rule_of(age=0.0, **changes):
    return SpeedSeparationParameters(**changes).rule(age)


def test_it_is_the_sum_of_the_standard():
    """ISO/TS 15066, 5.5.4.2.3: S_p = v_h (T_r + T_s) + v_r T_r + S_s + C + Z_d + Z_r."""
    rule = rule_of(reaction_time=0.1, intrusion=0.05, person_error=0.03, robot_error=0.01)
    S_p = protective_distance(rule, TABLE, 1.0, 1.0, 0.0)
    np.testing.assert_allclose(S_p, 1.6 * (0.1 + 0.12) + 1.0 * 0.1 + 0.07 + 0.05 + 0.03 + 0.01)


def test_a_robot_that_stands_or_goes_away_stops_nowhere():
    rule = rule_of(reaction_time=0.1, person_error=0.0, robot_error=0.0)
    np.testing.assert_allclose(protective_distance(rule, TABLE, 0.0, 0.0, 0.0), 0.16)
    np.testing.assert_allclose(protective_distance(rule, TABLE, 1.0, -1.0, 0.0), 1.6 * 0.22)


@settings(max_examples=30)
@given(st.floats(0.0, 3.0), st.floats(0.5, 20.0), st.floats(0.0, 1.0))
def test_the_way_of_a_person_is_the_integral_of_the_speed(speed, acceleration, time):
    rule, dt = rule_of(person_acceleration=acceleration), time / 2000
    at = (np.arange(2000) + 0.5) * dt
    expected = np.sum(np.minimum(min(speed, 1.6) + acceleration * at, 1.6)) * dt
    np.testing.assert_allclose(person_way(rule, speed, time), expected, atol=1e-5)
    assert person_way(rule, speed, time) <= person_way(rule_of(), speed, time) + 1e-12


def test_what_was_seen_long_ago_needs_more_distance():
    S = [protective_distance(rule_of(age), TABLE, 1.0, 0.5, 0.0) for age in (0.0, 0.1)]
    np.testing.assert_allclose(S[1] - S[0], 0.1 * (1.6 + 0.5))


def test_beyond_the_table_times_grow_with_the_speed():
    np.testing.assert_allclose(interpolated(4.0, TABLE[0], TABLE[1]), 0.4)
    np.testing.assert_allclose(interpolated(0.5, TABLE[0], TABLE[1]), 0.07)


def least_left(robot, v, people, rule):
    """Return the least distance beyond the protective one over all pairs, in plain loops."""
    surface, motion = surface_of(robot), robot.kinematics(robot.home).motion
    fastest, row, left = fastest_end(surface, motion, v), np.empty(robot.n), np.inf
    for s in range(len(surface.link)):
        for p, v_person, radius in zip(*people):
            d, p_WN, u = pair(surface, posed(surface, motion), s, p)
            towards(motion, surface.link[s], p_WN, u, row)
            left = min(left, d - radius - protective_distance(rule, TABLE, fastest, row @ v, -u @ v_person))
    return left


@pytest.mark.parametrize("seed", range(6))
def test_the_scale_is_the_largest_that_keeps_every_pair(lwr4, seed):
    rng, rule = np.random.default_rng(seed), rule_of(reaction_time=0.05)
    surface, motion = surface_of(lwr4), lwr4.kinematics(lwr4.home).motion
    v = lwr4.v_max * rng.uniform(-1, 1, 7)
    people = Balls(rng.uniform(-1.2, 1.2, (4, 3)), np.zeros((4, 3)), rng.uniform(0.0, 0.1, 4))
    scale, distance, protective, *_ = permitted_scale(surface, motion, v, people, rule, TABLE)
    if scale == 1.0:
        np.testing.assert_allclose(distance - protective, least_left(lwr4, v, people, rule), atol=1e-12)
        assert distance >= protective
    elif scale > 0.0:
        assert least_left(lwr4, scale * v, people, rule) >= -1e-9
        assert least_left(lwr4, min(1.0, scale + 1e-3) * v, people, rule) < 0.0
    else:
        assert least_left(lwr4, 2e-4 * v, people, rule) < 0.0


def test_nobody_slows_nothing(lwr4):
    people = Balls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    surface, motion = surface_of(lwr4), lwr4.kinematics(lwr4.home).motion
    assert permitted_scale(surface, motion, lwr4.v_max, people, rule_of(), TABLE)[:2] == (1.0, np.inf)
