"""The last element: commands pass within the envelope; without one the robot is braked and held, and stays so."""

import numpy as np
import pytest

from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus
from saphari_drake.stations.guard import Guard
from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.shared import StationStatus

T = 0.001


@pytest.fixture
def guard(lwr4):
    return Guard(lwr4, StationParameters())


def advance(robot, q, v, torque):
    """Return the state of the robot a period later (semi-implicit, as Drake's plant)."""
    terms = evaluate_dynamics(robot, q, v)
    v = v + T * np.linalg.solve(terms.M, torque - terms.Cv - terms.g)
    return q + T * v, v


def run(robot, guard, q, v, steps, command=None, fresh=True):
    """Return positions and velocities (steps, n) of the robot behind its guard."""
    states, torques = [], []
    for _ in range(steps):
        given = command(q, v) if command is not None else None
        torque = guard.step(q, v, given, fresh).torque
        q, v = advance(robot, q, v, torque)
        states.append((q, v))
        torques.append(torque)
    return np.array([s[0] for s in states]), np.array([s[1] for s in states]), np.array(torques)


def test_before_the_first_command_the_posture_is_held(lwr4, guard):
    q, v, _ = run(lwr4, guard, lwr4.home, np.zeros(7), 300)
    assert np.abs(q - lwr4.home).max() < 1e-6 and np.abs(v).max() < 1e-5


def test_a_command_within_limits_passes_bit_for_bit(lwr4, guard):
    weight = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g
    guarded = guard.step(lwr4.home, np.zeros(7), weight + 0.1, True)
    assert np.array_equal(guarded.torque, weight + 0.1)
    assert guarded.status == StationStatus.OK and guarded.limited.status == EnvelopeStatus.FREE


def test_torque_rate_and_size_are_bounded_whatever_is_asked(lwr4, guard):
    rng = np.random.default_rng(1)
    _, v, torques = run(lwr4, guard, lwr4.home, np.zeros(7), 400, lambda q, v: 1e3 * rng.standard_normal(7))
    assert np.abs(np.diff(torques, axis=0)).max() <= 800.0 * T + 1e-9
    assert np.all(np.abs(torques) <= lwr4.tau_max + 1e-9)
    assert np.all(np.abs(v) <= lwr4.v_max)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("how", ["stale", "nan"])
def test_a_robot_whose_diagram_dies_stops_within_its_limits(lwr4, guard, seed, how):
    """From random speeds: all limits kept, the speed falls, it stands in 0.5 s, and is held there."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(0.5 * lwr4.q_min, 0.5 * lwr4.q_max)
    v = 0.3 * lwr4.v_max * rng.uniform(-1.0, 1.0, 7)
    weight = evaluate_dynamics(lwr4, q, v)
    guard.step(q, v, weight.g + weight.Cv, True)
    asked = np.full(7, np.nan) if how == "nan" else np.zeros(7)
    qs, vs, _ = run(lwr4, guard, q, v, 900, lambda q, v: asked, how == "nan")
    assert np.all(np.abs(vs) <= lwr4.v_max) and np.all((qs >= lwr4.q_min) & (qs <= lwr4.q_max))
    assert np.abs(vs[500:]).max() < 0.05
    assert guard.step(qs[-1], vs[-1], asked, False).standing
    assert np.abs(qs[-1] - qs[600]).max() < 0.01


def test_a_stop_is_not_left_by_a_command(lwr4, guard):
    """Recovery is explicit: once too old, commands do not count any more."""
    weight = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g
    guard.step(lwr4.home, np.zeros(7), weight, True)
    guard.step(lwr4.home, np.zeros(7), weight, False)
    guarded = guard.step(lwr4.home, np.zeros(7), weight + 5.0, True)
    assert guarded.status == StationStatus.STALE
    assert np.abs(guarded.torque - weight).max() < 1e-6


def test_the_observer_sees_who_pushes(lwr4, guard):
    """A constant external torque on a held robot is told with its sign and size."""
    q, v, push = lwr4.home, np.zeros(7), np.array([2.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(400):
        guarded = guard.step(q, v, None, False)
        q, v = advance(lwr4, q, v, guarded.torque + push)
    assert np.abs(guarded.external - push).max() < 0.05
