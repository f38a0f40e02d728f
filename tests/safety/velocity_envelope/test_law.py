"""Whatever velocity is commanded, no joint leaves its position, speed, acceleration and jerk limits."""

import numpy as np
import pytest
from arms import arm_path

from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.robots.catalog import omnirob
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.velocity_envelope.law import Course, VelocityStatus, limited_velocity
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters, bounds_of

KINDS = ("noise", "extremes", "switching", "chasing")


def robot_of(name, tmp_path):
    return omnirob() if name == "omnirob" else RobotModel(arm_path(name, tmp_path))


def rest(robot, rng):
    low, high = np.maximum(robot.q_min, -2.0), np.minimum(robot.q_max, 2.0)
    q = 0.5 * (low + high) + 0.45 * (high - low) * rng.uniform(-1.0, 1.0, robot.n)
    return Course(q, np.zeros(robot.n), np.zeros(robot.n))


def command(rng, kind, v_max, course, before):
    """Return what is asked for: noise, all at ±10 limits, a square wave, or what is worst for where the joints go."""
    if kind == "noise":
        return 3.0 * v_max * rng.normal(size=len(v_max))
    if kind == "chasing":  # full speed ahead until the limit is near, then back
        return np.where(rng.random(len(v_max)) < 0.002, -1.0, 1.0) * 10.0 * v_max * np.sign(before + 1e-9)
    if kind == "switching" and rng.random() > 0.02:
        return before
    return 10.0 * v_max * rng.choice([-1.0, 1.0], len(v_max))


@pytest.mark.parametrize("name", ["lwr4", "omnirob", "panda", "xarm7"])
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_leaves_the_envelope(name, kind, tmp_path):
    """12 500 states for each robot and kind of command, 2 · 10⁵ in all, at every millisecond and between two."""
    robot, rng = robot_of(name, tmp_path), np.random.default_rng([len(name), len(kind)])
    b = bounds_of(robot, VelocityEnvelopeParameters())
    T, statuses, fastest = b.period, set(), np.zeros(robot.n)
    for _ in range(5):
        course = rest(robot, rng)
        wish = command(rng, "extremes", b.v_max, course, np.zeros(robot.n))
        for _ in range(2500):
            wish = command(rng, kind, b.v_max, course, wish)
            before = course
            course, status, joint, margin = limited_velocity(b, course, course.q, wish)
            statuses.add(VelocityStatus(status))
            assert (joint >= 0) == (status != VelocityStatus.FREE)
            assert margin >= -1e-9
            assert np.all(np.abs(course.v) <= b.v_max * (1.0 + 1e-9))
            assert np.all(np.abs(course.a) <= b.acceleration * (1.0 + 1e-9))
            assert np.all(np.abs(course.a - before.a) <= b.jerk * T * (1.0 + 1e-9))
            turn = np.where(before.v * course.v < 0.0, -0.5 * before.v**2 / np.where(course.a == 0, 1, course.a), 0.0)
            for q in (course.q, before.q + turn):
                assert np.all((q <= b.q_max + 1e-9) & (q >= b.q_min - 1e-9))
            fastest = np.maximum(fastest, np.abs(course.v) / b.v_max)
    assert VelocityStatus.BRAKING not in statuses
    assert kind in ("noise", "extremes") or fastest.max() > 0.9, "not won by standing still"


@pytest.mark.parametrize("name", ["lwr4", "omnirob", "panda", "xarm7"])
def test_the_motors_give_these_accelerations(name, tmp_path):
    """In postures that the bounds were not found from, all joints accelerating at once in the worst directions."""
    robot, rng = robot_of(name, tmp_path), np.random.default_rng(7)
    params = VelocityEnvelopeParameters()
    b, worst = bounds_of(robot, params), 0.0
    for _ in range(4000):
        q = rng.uniform(np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi))
        v = params.speed_share * robot.v_max * rng.uniform(-1.0, 1.0, robot.n)
        terms = evaluate_dynamics(robot, q, v)
        needed = np.abs(terms.M) @ b.acceleration + np.abs(terms.Cv + terms.g)
        worst = max(worst, np.max(needed / robot.tau_max))
    assert 0.5 < worst < 1.0


def test_a_slow_command_passes_as_it_is_and_steps_do_not_overshoot(lwr4):
    b = bounds_of(lwr4, VelocityEnvelopeParameters())
    course, wish = Course(lwr4.home, np.zeros(7), np.zeros(7)), np.zeros(7)
    for k in range(400):
        wish = 0.2 * np.sin(2.0 * np.pi * 0.3 * 0.001 * (k + 1)) * np.ones(7)
        course, status, joint, _ = limited_velocity(b, course, course.q, wish)
        assert (status, joint) == (VelocityStatus.FREE, -1)
        np.testing.assert_allclose(course.v, wish, atol=1e-12)
    course = Course(lwr4.home, np.zeros(7), np.zeros(7))
    target, reached = 0.5 * b.v_max * np.array([1, -1, 1, -1, 1, -1, 1.0]), np.zeros((600, 7))
    for k in range(600):
        course, status, _, _ = limited_velocity(b, course, course.q, target)
        reached[k] = course.v
    assert np.all(np.abs(reached) <= np.abs(target) + 1e-12)
    np.testing.assert_allclose(reached[-1], target, atol=1e-6)


def test_joints_that_do_not_follow_move_the_course(lwr4):
    """A measured position beyond the slip pulls the course along; inside it nothing changes."""
    b = bounds_of(lwr4, VelocityEnvelopeParameters())
    course = Course(lwr4.home, np.zeros(7), np.zeros(7))
    near, _, _, _ = limited_velocity(b, course, lwr4.home + 0.9 * b.slip, np.zeros(7))
    np.testing.assert_array_equal(near.q, lwr4.home)
    far, _, _, _ = limited_velocity(b, course, lwr4.home + 3.0 * b.slip, np.zeros(7))
    np.testing.assert_allclose(far.q, lwr4.home + 2.0 * b.slip)
    blind, _, _, _ = limited_velocity(b, course, np.full(7, np.nan), np.zeros(7))
    np.testing.assert_array_equal(blind.q, lwr4.home)


def test_what_is_wanted_is_not_exceeded():
    robot = omnirob()
    b = bounds_of(robot, VelocityEnvelopeParameters(acceleration_max=[1.0, 1.0, 1.0, *[8.0] * 7]))
    np.testing.assert_allclose(b.acceleration, [1.0, 1.0, 1.0, *[8.0] * 7], rtol=0.35)
    assert np.all(b.acceleration <= [1.0, 1.0, 1.0, *[8.0] * 7])


def test_a_robot_too_weak_to_hold_itself_or_without_limits_is_refused(lwr4):
    weak = RobotModel(lwr4.path, effort_limits=0.3 * lwr4.tau_max)
    with pytest.raises(ParameterError, match="cannot hold"):
        bounds_of(weak, VelocityEnvelopeParameters())
    fast = RobotModel(lwr4.path)
    fast.v_max = np.full(7, np.inf)
    with pytest.raises(ModelError, match="velocity limit of every joint"):
        bounds_of(fast, VelocityEnvelopeParameters())


@pytest.mark.parametrize("field", ["rise_time", "period", "torque_reserve", "speed_share", "lag"])
def test_bad_parameters_are_named(field):
    with pytest.raises(ParameterError, match=field):
        VelocityEnvelopeParameters(**{field: -1.0})
    with pytest.raises(ParameterError, match="acceleration_max"):
        VelocityEnvelopeParameters(acceleration_max=[0.0])


@pytest.mark.parametrize("name", ["lwr4", "omnirob"])
def test_all_jerks_at_once_keep_the_rate_of_the_torque(name, tmp_path):
    """In postures that the bounds were not found in; without it a platform asks for more than its drives give."""
    robot, rng, rate = robot_of(name, tmp_path), np.random.default_rng(5), 3.0e4
    low, high = np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi)
    M = np.abs([evaluate_dynamics(robot, rng.uniform(low, high), np.zeros(robot.n)).M for _ in range(300)])
    kept, free = (bounds_of(robot, VelocityEnvelopeParameters(torque_rate=x)).jerk for x in (rate, np.inf))
    assert (M @ kept).max() <= rate
    assert np.all(kept <= free)
    if name == "omnirob":
        assert (M @ free).max() > 3.0 * rate
