"""Whole arms under the worst commands: no joint leaves its envelope at any sample, and a stop always exists."""

import numpy as np
import pytest
from arms import arm_path

from saphari_drake.errors import ParameterError
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus, Motion, limited_torque, predicted
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters, envelope_of

STEP = 1.0e-5  # rad, of the encoders
COMMANDS = ("noise", "constant", "nothing", "switching")


def arm(name, tmp_path):
    return RobotModel(arm_path(name, tmp_path))


def command(rng, kind, tau_max, before):
    if kind == "noise":
        return rng.uniform(-1.0, 1.0, len(tau_max)) * 3.0 * tau_max
    if kind == "switching" and rng.random() > 0.01:
        return before
    return rng.choice([-1.0, 1.0], len(tau_max)) * tau_max if kind in ("switching", "constant") else 0.0 * tau_max


def run(robot, params, kind, seed, steps=600, push=0.0):
    """Simulate an arm with exact dynamics; return shares of speed, position, torque and rate, energy and statuses."""
    rng, envelope = np.random.default_rng(seed), envelope_of(robot, params)
    T, n = params.period, robot.n
    middle, half = 0.5 * (envelope.q_max + envelope.q_min), 0.5 * (envelope.q_max - envelope.q_min)
    q, v = middle + rng.uniform(-0.9, 0.9, n) * half, np.zeros(n)
    tau, external = evaluate_dynamics(robot, q, v).g, np.zeros(n)
    wish, pushed = command(rng, kind, robot.tau_max, tau), np.zeros(n)
    worst, energy, statuses = np.zeros(4), 0.0, set()
    for k in range(steps):
        terms = evaluate_dynamics(robot, q, v)
        wish = wish if kind == "constant" else command(rng, kind, robot.tau_max, wish)
        if k % 150 == 0:
            pushed = rng.uniform(-1.0, 1.0, n) * push * params.push_share * robot.tau_max
        external = external + np.clip(pushed - external, -0.05, 0.05)
        h = terms.Cv + terms.g
        torque, status, joint, _ = limited_torque(envelope, Motion(q, v, terms.M, h, external, tau), wish)
        statuses.add(EnvelopeStatus(status))
        assert (joint >= 0) == (status != EnvelopeStatus.FREE)
        rate = np.max(np.abs(torque - tau)) / (params.torque_rate * T)
        tau = torque
        v = v + T * np.linalg.solve(terms.M, tau + external - h)
        q = q + T * v
        shares = np.abs(v) / robot.v_max, np.abs(q - middle) / half, np.abs(tau) / robot.tau_max
        worst = np.maximum(worst, [*(np.max(share) for share in shares), rate])
        energy = max(energy, float(0.5 * v @ terms.M @ v))
    return worst, energy, statuses


@pytest.mark.parametrize("name", ["lwr4", "panda", "xarm7"])
@pytest.mark.parametrize("kind", COMMANDS)
@pytest.mark.parametrize("seed", range(4))
def test_nothing_leaves_the_envelope(name, kind, seed, tmp_path):
    """Speed, position, torque and its rate at each sample, with pushes within the share kept for them."""
    worst, _, statuses = run(arm(name, tmp_path), JointEnvelopeParameters(), kind, seed, push=1.0)
    np.testing.assert_array_less(worst, 1.0 + 1e-9)
    assert EnvelopeStatus.BRAKING not in statuses


@pytest.mark.parametrize("bound", [2.0, 5.0])
@pytest.mark.parametrize("seed", range(6))
def test_energy_stays_below_its_bound(bound, seed, tmp_path):
    worst, energy, statuses = run(
        arm("lwr4", tmp_path), JointEnvelopeParameters(kinetic_energy=bound), "switching", seed, 1200
    )
    assert 0.2 * bound < energy <= bound
    np.testing.assert_array_less(worst, 1.0 + 1e-9)
    assert EnvelopeStatus.ENERGY in statuses


def test_a_command_within_the_envelope_is_not_changed(tmp_path):
    robot = arm("lwr4", tmp_path)
    envelope, terms = envelope_of(robot, JointEnvelopeParameters()), evaluate_dynamics(robot, robot.home, np.zeros(7))
    wish = terms.g + terms.M @ np.full(7, 0.2)
    motion = Motion(robot.home, np.zeros(7), terms.M, terms.g, np.zeros(7), terms.g)
    torque, status, joint, margin = limited_torque(envelope, motion, wish)
    np.testing.assert_allclose(torque, wish, atol=1e-9)
    assert (status, joint) == (EnvelopeStatus.FREE, -1)
    assert 0.0 < margin < 1.0


def test_a_push_stronger_than_the_motors_is_braked_and_told(tmp_path):
    """Torques go to what brakes most, as fast as their rate allows, and stay within their limits."""
    robot = arm("lwr4", tmp_path)
    params = JointEnvelopeParameters()
    envelope = envelope_of(robot, params)
    q, v, push = robot.home.copy(), np.zeros(7), 3.0 * robot.tau_max * np.array([0, 0, 0, 1.0, 0, 0, 0])
    terms = evaluate_dynamics(robot, q, v)
    tau, statuses = terms.g, []
    for _ in range(120):
        terms = evaluate_dynamics(robot, q, v)
        h = terms.Cv + terms.g
        torque, status, _, margin = limited_torque(envelope, Motion(q, v, terms.M, h, push, tau), np.zeros(7))
        assert np.max(np.abs(torque - tau)) <= params.torque_rate * params.period * (1.0 + 1e-9)
        assert np.all(np.abs(torque) <= robot.tau_max * (1.0 + 1e-9))
        tau = torque
        v = v + params.period * np.linalg.solve(terms.M, tau + push - h)
        q = q + params.period * v
        statuses.append(status)
    assert EnvelopeStatus.BRAKING in statuses
    assert margin < 0.0
    assert tau[3] < -0.5 * robot.tau_max[3]


def test_a_robot_too_weak_to_stop_is_refused(tmp_path):
    robot = arm("lwr4", tmp_path)
    robot = RobotModel(robot.path, effort_limits=0.3 * robot.tau_max)
    with pytest.raises(ParameterError, match="cannot stop"):
        envelope_of(robot, JointEnvelopeParameters())


@pytest.mark.parametrize("field", ["torque_rate", "kinetic_energy", "period", "push_share"])
def test_bad_parameters_are_named(field):
    with pytest.raises(ParameterError, match=field):
        JointEnvelopeParameters(**{field: -1.0})


@pytest.mark.parametrize("delay", [0, 1, 4])
@pytest.mark.parametrize("age", [0.0, 0.5])
def test_torques_that_wait_move_the_robot_until_the_next_one_acts(lwr4, delay, age):
    """Each acts for a period, after that which acted while the velocity grew old; the way is that of these speeds."""
    rng, params = np.random.default_rng(delay), JointEnvelopeParameters()
    T, terms = params.period, evaluate_dynamics(lwr4, lwr4.home, rng.normal(size=7))
    h, external = terms.Cv + terms.g, rng.normal(size=7)
    torques = h + 20.0 * rng.normal(size=(6, 7))
    motion = Motion(terms.q, terms.v, terms.M, h, external, torques[-1])
    found = predicted(envelope_of(lwr4, params), motion, torques, delay, age * T)
    a = np.linalg.solve(terms.M, (torques + external - h).T).T
    speeds = terms.v + age * T * a[5 - delay] + T * np.cumsum(a[6 - delay :], axis=0)
    np.testing.assert_allclose(found.q, terms.q + T * speeds.sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(found.v, speeds[-1] if delay else terms.v + age * T * a[-1], rtol=1e-9)
    np.testing.assert_array_equal(found.tau, torques[-1])


@pytest.mark.parametrize("name", ["lwr4", "panda", "xarm7"])
@pytest.mark.parametrize("outside", [0.0, 1e-9, 1e-5, 1e-3])
def test_a_joint_on_its_limit_leaves_the_torque_of_the_others(name, outside, tmp_path):
    """Any joint on any limit, or beyond it, pushed outward by hand or command, while others are asked to move."""
    robot = RobotModel(arm_path(name, tmp_path))
    params, rng = JointEnvelopeParameters(), np.random.default_rng(3)
    envelope, n = envelope_of(robot, params), robot.n
    for _ in range(200):
        joint, side = rng.integers(n), rng.choice([-1.0, 1.0])
        q = envelope.q_min + rng.uniform(0.2, 0.8, n) * (envelope.q_max - envelope.q_min)
        limit = envelope.q_max if side > 0.0 else envelope.q_min
        if not np.isfinite(limit[joint]):
            continue
        q[joint] = limit[joint] + side * outside
        v = np.zeros(n)
        v[joint] = side * rng.choice([0.0, STEP / params.period])  # as encoders tell of a joint at rest
        terms = evaluate_dynamics(robot, q, v)
        h = terms.Cv + terms.g
        pushed = rng.uniform(-1.0, 1.0, n) * 0.3 * params.push_share * robot.tau_max
        before = np.clip(h - pushed, -robot.tau_max, robot.tau_max)
        wish = before + terms.M @ (rng.uniform(-0.5, 0.5, n) * envelope.jerk * params.period)
        wish[joint] = before[joint] + side * 0.4 * params.torque_rate * params.period
        wish = np.clip(wish, -robot.tau_max, robot.tau_max)
        torque, status, held, _ = limited_torque(envelope, Motion(q, v, terms.M, h, pushed, before), wish)
        others = np.arange(n) != joint
        np.testing.assert_allclose(torque[others], wish[others], atol=1e-6)
        led = np.linalg.solve(terms.M, torque + pushed - h)[joint]
        if status != EnvelopeStatus.FREE:  # else the others' motion takes it inward
            assert (status, held) == (EnvelopeStatus.POSITION, joint)
            assert side * led <= 1e-6


@pytest.mark.parametrize("name", ["lwr4", "panda"])
@pytest.mark.parametrize("seed", range(3))
def test_a_joint_on_its_limit_stays_there_while_a_push_moves_the_others(name, seed, tmp_path):
    """The command drives it outward for a second; no BRAKING, no limit of the robot left, and the others give way."""
    robot, rng = RobotModel(arm_path(name, tmp_path)), np.random.default_rng(seed)
    params = JointEnvelopeParameters()
    envelope, n, T = envelope_of(robot, params), robot.n, params.period
    joint, side = rng.integers(n), rng.choice([-1.0, 1.0])
    q, v = 0.5 * (envelope.q_min + envelope.q_max), np.zeros(n)
    q[joint] = (envelope.q_max if side > 0.0 else envelope.q_min)[joint]
    terms = evaluate_dynamics(robot, q, v)
    start, tau, seen = q.copy(), terms.g, q.copy()
    pushed = terms.M @ np.where(np.arange(n) == joint, 0.0, 2.0)
    for k in range(1000):
        read = STEP * np.rint(q / STEP)
        terms, known = evaluate_dynamics(robot, q, v), evaluate_dynamics(robot, read, (read - seen) / T)
        seen, h = read, known.Cv + known.g
        external = min(k / 200.0, 1.0) * pushed
        wish = known.g - known.M @ (10.0 * (read - start) + 10.0 * known.v)
        wish[joint] += side * 0.2 * robot.tau_max[joint]
        motion = Motion(read, known.v, known.M, h, external, tau)
        tau, status, *_ = limited_torque(envelope, motion, wish)
        assert status != EnvelopeStatus.BRAKING
        v = v + T * np.linalg.solve(terms.M, tau + external - terms.Cv - terms.g)
        q = q + T * v
        assert np.all((robot.q_min <= q) & (q <= robot.q_max))
    moved = np.abs(q - start)
    assert moved[joint] < 0.02
    assert np.max(moved) > 0.05
