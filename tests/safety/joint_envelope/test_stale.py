"""When a command that is repeated comes from a dead controller."""

import numpy as np

from saphari_drake.safety.joint_envelope.stale import Repeated, after

PERIOD, STALE = 0.001, 0.003
ONE, TWO = np.array([1.0, 2.0]), np.array([1.0, 2.1])
REST = np.zeros(2)


NONE = np.full(2, np.nan)
START = Repeated(REST, np.zeros(4), 0.0, NONE)


def later(known, commands, states):
    for command, q in zip(commands, states):
        known = after(known, command, np.append(np.full(2, q), REST), PERIOD, STALE)
    return known


def test_repeated_while_the_state_changes_it_is_stale():
    known = later(START, [ONE] * 4, [1.0, 2.0, 3.0, 4.0])
    assert known.time == 3 * PERIOD
    np.testing.assert_array_equal(known.q_hold, [4.0, 4.0])
    np.testing.assert_array_equal(later(known, [ONE], [5.0]).q_hold, [4.0, 4.0])


def test_nothing_is_known_while_nothing_changes():
    assert np.isnan(later(START, [ONE] * 50, [1.0] * 50).q_hold).all()


def test_a_new_command_ends_it():
    known = later(START, [ONE] * 5 + [TWO], np.arange(6.0))
    assert known.time == 0.0 and np.isnan(known.q_hold).all()


def test_a_command_that_is_not_finite_is_stale_at_once():
    bad = np.array([np.nan, 0.0])
    known = later(START, [bad, bad], [1.0, 1.0])
    np.testing.assert_array_equal(known.q_hold, [1.0, 1.0])
