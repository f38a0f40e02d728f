"""The envelope in a diagram: its ports, and what it does when state or command are not known."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.safety.velocity_envelope.law import VelocityStatus
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters
from saphari_drake.safety.velocity_envelope.system import VelocityEnvelope

PERIOD = 0.005  # of the bench


def envelope(robot):
    return VelocityEnvelope(robot, VelocityEnvelopeParameters(period=PERIOD))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("port", ["position_measured", "velocity_commanded"])
def test_what_is_not_known_is_told_and_the_joints_come_to_rest(lwr4, bad, port):
    """Within acceleration and jerk limits, and the envelope goes on when all is known again."""
    system = envelope(lwr4)
    good = {"position_measured": lwr4.home, "velocity_commanded": np.full(7, 0.5)}
    b = Bench(system, **good)
    b.run(60)
    np.testing.assert_allclose(b.read("velocity_applied"), 0.5, atol=1e-3)
    before, a_before = b.read("velocity_applied"), np.zeros(7)
    for k in range(60):
        b.run(1, **{port: np.full(7, bad)})
        v = b.read("velocity_applied")
        a = (v - before) / PERIOD
        assert b.read("status") == VelocityStatus.BAD_INPUT
        assert np.isfinite(b.read("velocity_excess")).all() and np.isfinite(b.read("margin"))
        assert np.all(np.abs(a) <= system.bounds.acceleration * (1.0 + 1e-9))
        if k > 0:
            assert np.all(np.abs(a - a_before) <= system.bounds.jerk * PERIOD * (1.0 + 1e-9))
        before, a_before = v, a
    np.testing.assert_allclose(v, 0.0, atol=1e-6)
    b.run(100, **good)
    assert b.read("status") != VelocityStatus.BAD_INPUT
    np.testing.assert_allclose(b.read("velocity_applied"), 0.5, atol=1e-3)


def test_it_starts_at_rest_where_the_robot_stands(lwr4):
    """Near a limit it commands nothing towards it; excess, joint and status tell."""
    q = lwr4.home.copy()
    q[3] = lwr4.q_max[3] - 0.0011
    b = Bench(envelope(lwr4), position_measured=q, velocity_commanded=np.array([0, 0, 0, 1.0, 0, 0, 0]))
    np.testing.assert_array_equal(b.read("velocity_applied"), 0.0)
    b.run(3)
    assert abs(b.read("velocity_applied")[3]) < 0.05
    np.testing.assert_allclose(b.read("velocity_applied") + b.read("velocity_excess"), [0, 0, 0, 1.0, 0, 0, 0])
    assert (b.read("status"), b.read("joint")) == (VelocityStatus.POSITION, 3)
    assert -1e-9 <= b.read("margin") < 0.01


def test_a_clone_goes_on_as_the_original(lwr4):
    one = Bench(envelope(lwr4), position_measured=lwr4.home, velocity_commanded=np.full(7, 0.5))
    one.run(5)
    two = one.clone()
    for b in (one, two):
        b.run(5, velocity_commanded=np.full(7, -0.5))
    np.testing.assert_array_equal(one.read("velocity_applied"), two.read("velocity_applied"))


def test_a_command_of_a_dead_controller_brings_the_joints_to_rest(lwr4):
    """The same, bit for bit, while the robot moves; zero is never stale, nor a command while nothing moves."""
    system = VelocityEnvelope(lwr4, VelocityEnvelopeParameters(period=PERIOD, stale_time=0.05))
    b, q = Bench(system, position_measured=lwr4.home, velocity_commanded=np.full(7, 0.3)), lwr4.home
    b.run(40)
    assert b.read("status") != VelocityStatus.BAD_INPUT
    for k in range(40):
        q = q + PERIOD * b.read("velocity_applied")
        b.run(1, position_measured=q, velocity_commanded=np.full(7, 0.3 + 1e-9 * k))
        assert b.read("status") != VelocityStatus.BAD_INPUT
    told = []
    for _ in range(60):
        q = q + PERIOD * b.read("velocity_applied") + 1e-7
        b.run(1, position_measured=q)
        told.append(b.read("status") == VelocityStatus.BAD_INPUT)
    assert told.index(True) == 10 and all(told[10:])
    np.testing.assert_allclose(b.read("velocity_applied"), 0.0, atol=1e-6)
    for k in range(40):
        b.run(1, position_measured=q + 1e-6 * k, velocity_commanded=np.zeros(7))
        assert b.read("status") != VelocityStatus.BAD_INPUT
