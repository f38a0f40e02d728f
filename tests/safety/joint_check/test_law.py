"""What contradicts itself is told, and what any joint may do is not."""

import numpy as np
import pytest

from saphari_drake.safety.joint_check.law import JointCheckStatus, Joints, judged, remembered, unknown
from saphari_drake.safety.joint_check.parameters import JointCheckParameters, tolerances

PERIOD, STEP = 0.005, 1e-4  # s; rad of a coarse encoder
NAN = np.full(7, np.nan)


@pytest.fixture(scope="module")
def limits(lwr4):
    return tolerances(lwr4, JointCheckParameters(period=PERIOD))


def told(limits, readings, second=None, expected=None, measured=None):
    """Return the status after each sample."""
    joints, statuses = unknown(7), []
    for k, q in enumerate(readings):
        statuses.append(judged(limits, joints, q, NAN if second is None else second[k])[0])
        torques = (NAN if each is None else each[k] for each in (expected, measured))
        joints = Joints(*remembered(limits, joints, q, *torques))
    return statuses


def swing(times, amplitude=0.3, frequency=4.0):
    return amplitude * np.sin(frequency * times)[:, None] * np.ones(7)


def test_any_motion_within_the_speed_limits_is_believed(limits, lwr4):
    """Random courses of joints at their largest speed, encoders of any step, standing still in between."""
    rng = np.random.default_rng(0)
    for step in (1e-6, STEP):
        v = np.repeat(rng.uniform(-1.0, 1.0, (40, 7)), 25, axis=0) * lwr4.v_max
        v[300:400] *= np.linspace(1.0, 0.0, 100)[:, None] ** 2
        v[400:500] = 0.0
        q = step * np.round(np.cumsum(PERIOD * v, axis=0) / step)
        assert set(told(limits, q, q + rng.uniform(-5e-3, 5e-3, q.shape))) == {JointCheckStatus.OK}


def test_a_glitch_is_told_in_its_own_sample(limits):
    q = swing(PERIOD * np.arange(40))
    q[20, 3] += 0.1
    statuses = told(limits, q)
    assert statuses[20] == statuses[21] == JointCheckStatus.JUMP
    assert set(statuses[:20] + statuses[22:]) == {JointCheckStatus.OK}


def test_a_fast_joint_does_not_stop_within_a_sample(limits):
    """Readings that freeze at 1.2 rad/s: told after three that are the same, without any second encoder."""
    q = swing(PERIOD * np.arange(60))
    q[30:, 2] = q[29, 2] if abs(np.cos(4.0 * PERIOD * 29)) > 0.5 else np.nan
    statuses = told(limits, q)
    assert set(statuses[:32]) == {JointCheckStatus.OK} and set(statuses[32:]) == {JointCheckStatus.FROZEN}


def test_a_joint_that_differs_from_its_second_encoder_is_told_when_it_has_moved(limits):
    """A slow joint that freezes: harmless until the other encoder has moved by the tolerance."""
    motors = swing(PERIOD * np.arange(200), amplitude=0.02)
    q = motors.copy()
    q[40:, 5] = q[40, 5]
    statuses, way = told(limits, q, motors), np.abs(motors - q).max(axis=1)
    for status, moved in zip(statuses, way):
        assert (status == JointCheckStatus.ENCODERS) == (moved > limits.encoder)
    assert JointCheckStatus.ENCODERS in statuses


def test_a_torque_is_averaged_before_it_is_believed_to_be_wrong(limits):
    """1 Nm more is told within 0.1 s, what a sound drive errs by never: offset, ripple and noise of 0.05 Nm."""
    rng, q = np.random.default_rng(1), np.zeros((2000, 7)) + STEP * (np.arange(2000) % 2)[:, None]
    asked = np.cumsum(0.05 * rng.normal(size=q.shape), axis=0)
    got = asked + 0.4 + 0.07 * rng.normal(size=q.shape)
    assert set(told(limits, q, None, asked, got)) == {JointCheckStatus.OK}
    got[1000:, 1] = asked[1000:, 1] - 1.0 + 0.05 * rng.normal(size=1000)
    statuses = told(limits, q, None, asked, got)
    first = statuses.index(JointCheckStatus.TORQUE)
    assert 1000 < first <= 1000 + 0.05 / PERIOD


def test_a_drive_that_is_a_sample_early_or_late_is_sound(limits):
    times, q = PERIOD * np.arange(400), np.zeros((400, 7)) + STEP * (np.arange(400) % 2)[:, None]
    asked = swing(times, 30.0, 6.0)
    for late in (-1, 1):
        got = np.roll(asked, late, axis=0)
        assert set(told(limits, q[1:-1], None, asked[1:-1], got[1:-1])) == {JointCheckStatus.OK}
