"""Places and their probabilities: modes beside each other are one place, and what is unlikely is left out."""

import numpy as np
import pytest

from saphari_drake.perception.contact.values import Fusion, Mode, weighed


def mode(cost):
    return Mode(1, np.zeros(3), np.ones(3), cost, False, np.inf)


def test_probabilities_are_those_of_the_costs():
    modes, points = [mode(2.0 * np.log(3.0)), mode(0.0)], np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    places, weights = weighed(modes, points, 0.05, 0.05)
    assert places == [modes[1], modes[0]]
    np.testing.assert_allclose(weights, [0.75, 0.25])


def test_modes_beside_each_other_are_one_place():
    modes, points = [mode(0.0), mode(0.0), mode(0.0)], np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.5, 0.0, 0.0]])
    places, weights = weighed(modes, points, 0.05, 0.05)
    assert len(places) == 2
    np.testing.assert_allclose(weights, [2.0 / 3.0, 1.0 / 3.0])


@pytest.mark.parametrize(("share", "count"), [(0.06, 2), (0.04, 1)])
def test_what_is_less_likely_than_five_percent_is_left_out(share, count):
    modes = [mode(0.0), mode(-2.0 * np.log(share / (1.0 - share)))]
    places, weights = weighed(modes, np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), 0.05, 0.05)
    assert len(places) == count
    assert weights[0] == pytest.approx(1.0 - share)


def test_message_has_a_contact_a_weight():
    sent = Fusion([], None, 0.0, np.zeros((0, 3)), [mode(0.0), mode(1.0)], np.array([0.6, 0.4])).all_modes(2.0)
    assert [contact.found for contact in sent.contacts] == [True, True]
    assert sent.contacts[0].stamp == sent.stamp == 2.0
    np.testing.assert_array_equal(sent.weights, [0.6, 0.4])
