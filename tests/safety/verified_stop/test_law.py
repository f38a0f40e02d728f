"""Adversaries command the robot and run at it: they may touch it where it stands, never while it moves."""

from dataclasses import replace

import numpy as np
import pytest

from saphari_drake.math.primitives import BOX
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.nearness import Balls, surface_of
from saphari_drake.safety.power_force.law import Contact, Rule, contact_scale
from saphari_drake.safety.power_force.parameters import PowerForceParameters, walls_of
from saphari_drake.safety.power_force.regions import limits_of, read_regions
from saphari_drake.safety.velocity_envelope.law import Course, limited_velocity
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters, bounds_of
from saphari_drake.safety.verified_stop.law import StopStatus, Surroundings, checked_velocity, stop_margin
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters, body_of
from saphari_drake.safety.verified_stop.touch import Touch

SPEED, RADIUS, PERIOD = 2.0, 0.08, 0.005


def surface(robot, q, points):
    """Return the distances (shapes, points) of the robot's surface from points (m, 3), by plain formulas."""
    k, s, rows = robot.kinematics(q), robot.shapes, []
    for i in np.flatnonzero(s.link >= 0):
        p_L = (np.asarray(points) - k.p_WL[s.link[i]]) @ k.R_WL[s.link[i]]
        p_S = (p_L - s.p_LS[i]) @ s.R_LS[i]
        if s.kind[i] == BOX:
            rows.append(np.linalg.norm(np.maximum(np.abs(p_S) - s.size[i], 0.0), axis=1))
        else:
            p_S[:, 2] -= np.clip(p_S[:, 2], -s.size[i, 1], s.size[i, 1])
            rows.append(np.linalg.norm(p_S, axis=1) - s.size[i, 0])
    return np.array(rows)


def balls(p, radius=RADIUS, growth=SPEED, v=0.0):
    p = np.atleast_2d(np.asarray(p, dtype=float))
    return Surroundings(p, np.zeros_like(p) + v, np.full(len(p), radius), np.full(len(p), growth))


def start_posture(robot, rng):
    q = robot.home.copy()
    low, high = np.maximum(robot.q_min, q - 0.5), np.minimum(robot.q_max, q + 0.5)
    return rng.uniform(low + 0.02, high - 0.02)


@pytest.mark.parametrize("name", ["lwr4", "omnirob"])
@pytest.mark.parametrize("seed", range(3))
def test_no_contact_while_the_robot_moves(name, seed):
    """Commands at random, and people who run at the robot, seen 15 times a second only and without velocities."""
    robot, rng = catalog.load(name), np.random.default_rng([seed, len(name)])
    params = VerifiedStopParameters()
    body, T, n = body_of(robot, params), params.motion.period, robot.n
    moved, touched, statuses = 0, 0, set()
    for _ in range(3):
        q, v = start_posture(robot, rng), np.zeros(n)
        people = robot.kinematics(q).p_WL[-1] + 1.2 * rng.normal(size=(3, 3))
        people[:, 2] = np.abs(people[:, 2])
        people = people[surface(robot, q, people).min(axis=0) > 0.3]
        seen, stamp, command = people.copy(), 0.0, np.zeros(n)
        runs = rng.random(len(people)) < 0.7
        for k in range(1200):
            time = k * T
            if k % 66 == 0:
                seen, stamp = people.copy(), time
                runs = rng.random(len(people)) < 0.5
            if k % 40 == 0:
                command = 3.0 * robot.v_max * rng.normal(size=n) * (rng.random(n) < 0.6)
            around = balls(seen, RADIUS + SPEED * (time - stamp)) if len(people) else balls(np.zeros((0, 3)))
            before = v
            v, status, margin, stop_time = checked_velocity(body, params.intervals, q, v, command, True, around)
            statuses.add(StopStatus(status))
            assert np.all(np.abs(v - before) <= body.deceleration * T * (1.0 + 1e-9))
            assert margin >= 0.0 or status == StopStatus.STOPPING
            assert (stop_time > 0.0) == bool(np.any(v != 0.0))
            q = q + T * v
            assert np.all((q <= robot.q_max) & (q >= robot.q_min))
            goal = robot.kinematics(q).p_WL[rng.integers(n)]
            way = goal - people
            step = SPEED * T / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), SPEED * T)
            people = people + runs[:, None] * step * way
            if len(people):
                gap = surface(robot, q, people).min() - RADIUS
                touched += gap < 0.0
                assert gap >= -1e-9 or not np.any(v)
            moved += bool(np.any(np.abs(v) > 1e-3))
    assert moved > 100
    assert {StopStatus.PASSING, StopStatus.STOPPING} <= statuses


@pytest.mark.parametrize("name", ["lwr4", "omnirob"])
def test_the_margin_is_never_more_than_what_is_left(name):
    """Against the stop by plain formulas, at hundreds of instants; and it is not much less."""
    robot, rng = catalog.load(name), np.random.default_rng(1)
    params = VerifiedStopParameters()
    body, lost = body_of(robot, params), []
    hold = body.period + body.hold
    for _ in range(150):
        q, v = start_posture(robot, rng), 0.5 * robot.v_max * rng.uniform(-1.0, 1.0, robot.n)
        p = robot.kinematics(q).p_WL[-1] + 0.5 * rng.normal(size=(4, 3))
        v_O = rng.normal(size=(4, 3))
        around = Surroundings(p, v_O, rng.uniform(0, 0.1, 4), rng.uniform(0.0, 0.5, 4))
        told = stop_margin(body, params.intervals, q, v, around)
        stop, left = np.max(np.abs(v) / body.deceleration), np.inf
        for t in np.linspace(0.0, hold + stop, 120):
            s = min(t - hold, stop)
            way = t if t <= hold else hold + s - 0.5 * s * s / stop
            gaps = surface(robot, q + way * v, p + t * v_O) - around.radius - around.growth * t
            left = min(left, gaps.min())
        if told == -np.inf:
            continue
        assert told <= max(left, 0.0) + 1e-9 or told <= left + 1e-9
        if left > 0.0 and told >= 0.0:
            lost.append(left - told)
    assert len(lost) > 5


def test_a_command_away_from_people_passes_and_one_towards_them_is_slowed(lwr4):
    """The robot comes as near as the speed of people lets it, and then holds or stops."""
    params = VerifiedStopParameters()
    body, q, v = body_of(lwr4, params), lwr4.home.copy(), np.zeros(7)
    person = lwr4.kinematics(q + np.array([1.4, 0, 0, 0, 0, 0, 0])).p_WL[-1]
    towards = np.array([1.0, 0, 0, 0, 0, 0, 0])
    speeds, statuses = [], []
    for _ in range(3000):
        v, status, _, _ = checked_velocity(body, 10, q, v, towards, True, balls(person))
        q = q + 0.001 * v
        speeds.append(v[0])
        statuses.append(status)
    assert max(speeds) > 0.9
    assert abs(speeds[-1]) < 0.35 and set(statuses) >= {StopStatus.PASSING, StopStatus.HOLDING}
    gap = surface(lwr4, q, person[None]).min() - RADIUS
    assert 0.0 < gap < 0.25
    for _ in range(300):
        v, status, _, _ = checked_velocity(body, 10, q, v, -towards, True, balls(person + [0.0, 1.0, 0.0]))
        q = q + 0.001 * v
    assert v[0] < -0.9 and status == StopStatus.PASSING


def test_a_stop_keeps_the_joint_path(lwr4):
    """And takes the time that was told."""
    body = body_of(lwr4, VerifiedStopParameters())
    q, v = lwr4.home.copy(), np.array([0.8, -0.4, 0.3, 0.5, -0.6, 0.2, 0.9])
    first, time, steps = v.copy(), np.max(np.abs(v) / body.deceleration), 0
    while np.any(v):
        v, status, margin, _ = checked_velocity(body, 10, q, v, 0.0 * v, False, balls(np.zeros((0, 3))))
        assert status == StopStatus.STOPPING and np.isnan(margin)
        np.testing.assert_allclose(np.cross(v[:3], first[:3]), 0.0, atol=1e-12)
        steps += 1
    assert abs(steps * 0.001 - time) <= 0.0011


def test_a_joint_at_its_limit_stops_in_time(lwr4):
    body, v = body_of(lwr4, VerifiedStopParameters()), np.zeros(7)
    q = lwr4.home.copy()
    for _ in range(3000):
        v, _, _, _ = checked_velocity(body, 10, q, v, np.full(7, 1.5), True, balls(np.zeros((0, 3))))
        q = q + 0.001 * v
        assert np.all(q <= lwr4.q_max)
    assert np.min(lwr4.q_max - q) < 0.1


@pytest.mark.parametrize("soft", [True, False])
def test_people_may_be_touched_softly_if_that_is_allowed(soft):
    """Driven at a person beyond the reach of its stop: it gets there as fast as a touch may be, or stands before."""
    robot, params = catalog.load("lwr4"), VerifiedStopParameters()
    body, outside, contact = body_of(robot, params), surface_of(robot), PowerForceParameters()
    limits = limits_of(read_regions(""), contact.regions)
    rule = Rule(limits, walls_of(contact.structures), np.inf, contact.clamp_gap, contact.thickest, contact.still)
    q, v, command = robot.home.copy(), np.zeros(7), np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    turned = q.copy()
    turned[0] += 0.6
    person = np.atleast_2d(robot.kinematics(turned).p_WL[-1])
    people = Balls(person, 0.0 * person, np.array([RADIUS]))
    touch = Touch(outside, rule, people, np.array([0]))
    fastest = 0.0
    for _ in range(3000):
        given = body, 10, q, v, command, True, balls(person)
        v = checked_velocity(*given, touch)[0] if soft else checked_velocity(*given)[0]
        q, fastest = q + params.motion.period * v, max(fastest, v.max())
        terms = evaluate_dynamics(robot, q, v)
        near = surface(robot, q, person).min() - RADIUS
        if near <= 0.0:
            break
    assert (near <= 0.0) == soft
    assert fastest > 0.5
    allowed = Contact(*contact_scale(outside, terms.motion, terms.M, v, people, np.array([False]), rule))
    assert v.max() > 0.1 if soft else v.max() == 0.0
    assert allowed.scale > 0.99


def test_an_envelope_behind_follows_a_stop_within_the_time_that_is_held_for_it():
    """The platform turned from full acceleration to a stop, its jerk that of slow drives: no farther than foreseen."""
    robot, motion = catalog.omnirob(), VelocityEnvelopeParameters(torque_rate=3.0e4, period=PERIOD)
    params = VerifiedStopParameters(motion=motion, envelope_behind=True)
    body, bounds = body_of(robot, params), bounds_of(robot, replace(motion, period=0.001))
    course = Course(robot.home.copy(), np.zeros(robot.n), np.zeros(robot.n))
    v, told = np.zeros(robot.n), np.inf
    for k in range(800):
        if k % 5 == 0 and k < 60:  # while it accelerates
            wish = np.zeros(robot.n)
            wish[0] = 0.5
            v = checked_velocity(body, 10, course.q, v, wish, True, balls(np.zeros((0, 3))))[0]
            told = course.q[0] + v[0] * (body.period + body.hold + 0.5 * v[0] / body.deceleration[0])
        elif k % 5 == 0:
            v = checked_velocity(body, 10, course.q, v, 0.0 * v, True, balls(np.zeros((0, 3))))[0]
        course = Course(*limited_velocity(bounds, course, course.q, v)[0])
    assert abs(course.v[0]) < 1e-6
    assert 0.01 < course.q[0] <= told
