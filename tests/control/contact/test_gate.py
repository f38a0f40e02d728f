"""The gate of the force control: hysteresis, ramp, and the speed stop."""

import numpy as np
import pytest

from saphari_drake.control.contact.gate import ForceGate, ForceStatus
from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.messages import InteractionMode

HOLD, CONTACT, RETURN, YIELD, STOP = InteractionMode
PARAMS = ContactForceControlParameters()


def test_gate_has_hysteresis():
    """It opens above 3 N, stays open down to 1.5 N, and a force that is not a number closes it."""
    gate = ForceGate()
    for force, opened in ((2.9, False), (3.1, True), (1.6, True), (1.4, False), (2.9, False), (4.0, True)):
        gate = gate.after(CONTACT, force, PARAMS)
        assert gate.open is opened
    assert not gate.after(CONTACT, np.nan, PARAMS).open


@pytest.mark.parametrize("mode", [HOLD, RETURN, YIELD, STOP])
def test_gate_is_closed_without_a_known_contact(mode):
    assert not ForceGate(open=True, size=15.0).after(mode, 20.0, PARAMS).open


def test_size_rises_from_the_estimate_at_the_force_rate():
    """10 N/s: from 5 N to 15 N in a second, from 25 N down as fast; at once if the rate is 0."""
    for force in (5.0, 25.0):
        gate = ForceGate().after(CONTACT, force, PARAMS)
        assert gate.size == force
        for _ in range(100):
            gate = gate.after(CONTACT, 25.0, PARAMS)
        assert gate.size == pytest.approx(force + 0.5 * (15.0 - force))
    at_once = ContactForceControlParameters(force_rate=0.0)
    assert ForceGate().after(CONTACT, 14.0, at_once).size == 15.0


def test_size_does_not_run_after_a_hand_that_leaves():
    gate = ForceGate(open=True, size=15.0).after(CONTACT, 2.0, PARAMS)
    assert gate.size == 2.0 + PARAMS.max_deficit


def test_speed_stop_holds_until_the_release():
    """Weak and strong forces, a lost sight and a lost camera do not end it; a release does."""
    still = np.zeros(3)
    gate = ForceGate(open=True, size=15.0).checked(np.array([0.0, -0.26, 0.0]), still, PARAMS)
    for mode in (CONTACT, YIELD, STOP, CONTACT):
        gate = gate.after(mode, 20.0, PARAMS)
        assert gate.stopped and not gate.open
        np.testing.assert_array_equal(gate.stop_velocity, [0.0, -0.26, 0.0])
    assert gate.status(CONTACT) == ForceStatus.SPEED_STOP
    assert not gate.after(RETURN, 0.0, PARAMS).stopped
    assert ForceGate(open=True).checked(np.full(3, np.nan), still, PARAMS).stopped
    assert ForceGate(open=True).checked(still, np.full(3, np.nan), PARAMS).stopped


def test_speed_stop_looks_ahead():
    """0.1 m/s stops if it would reach the limit soon, and 0.24 m/s even if it falls."""
    v, a = np.array([0.1, 0.0, 0.0]), np.array([10.0, 0.0, 0.0])
    assert not ForceGate(open=True).checked(v, 0.1 * a, PARAMS).stopped
    assert ForceGate(open=True).checked(v, a, PARAMS).stopped
    assert ForceGate(open=True).checked(2.4 * v, -a, PARAMS).stopped


def test_a_hand_that_leaves_is_followed_so_far_and_no_farther():
    """Against the desired force, that is towards the hand; what the hand pushes back counts as way back."""
    params = ContactForceControlParameters(follow_limit=0.05)
    gate, F_d, u = ForceGate(open=True, size=15.0), np.array([0.0, 15.0, 0.0]), np.array([0.0, -1.0, 0.0])
    for _ in range(40):
        gate = gate.following(0.2 * u, F_d, params)
    assert gate.open and gate.followed == pytest.approx(0.04)
    for _ in range(20):
        gate = gate.following(-0.2 * u, F_d, params)
    assert gate.followed == pytest.approx(0.02)
    for _ in range(40):
        gate = gate.following(0.2 * u, F_d, params)
    assert gate.stopped and not gate.open
    np.testing.assert_array_equal(gate.stop_velocity, 0.2 * u)


def test_the_stop_looks_ahead_farther_by_the_delay_of_the_torque():
    now, later = ContactForceControlParameters(), ContactForceControlParameters(torque_delay=0.01)
    v, a, gate = np.array([0.1, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]), ForceGate(open=True)
    assert not gate.checked(v, a, now).stopped
    assert gate.checked(v, a, later).stopped


def test_a_force_that_drops_closes_the_gate_for_the_leave_time():
    """A force of 8 N is above the gate; after 15 N it is friction of the arm's own motion."""
    params = ContactForceControlParameters()
    gate = ForceGate()
    for force in [15.0] * 40 + [8.0]:
        gate = gate.after(InteractionMode.CONTACT, force, params)
    assert not gate.open
    for _ in range(round(params.leave_time / params.period)):
        gate = gate.after(InteractionMode.CONTACT, 8.0, params)
    assert gate.open
