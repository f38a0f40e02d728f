"""Places and their probabilities: modes beside each other are one place, and what is unlikely is left out."""

import numpy as np
import pytest

from saphari_drake.perception.contact.evidence import best_apart
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


def test_places_are_those_of_one_comparison_after_the_other():
    rng = np.random.default_rng(0)
    for _ in range(20):
        points, modes = rng.uniform(-0.2, 0.2, (120, 3)), [mode(cost) for cost in rng.uniform(0.0, 6.0, 120).round(1)]
        share = np.exp(-0.5 * np.array([m.cost for m in modes]))
        leaders, total = [], np.zeros(len(modes))
        for i in np.argsort([m.cost for m in modes], kind="stable"):
            near = next((j for j in leaders if np.linalg.norm(points[i] - points[j]) < 0.1), i)
            total[near] += share[i] / share.sum()
            leaders += [i] if near == i else []
        places, weights = weighed(modes, points, 0.1, 0.01)
        expected = sorted((i for i in leaders if total[i] >= 0.01), key=lambda i: -total[i])
        assert [id(place) for place in places] == [id(modes[i]) for i in expected]
        np.testing.assert_allclose(weights, total[expected])


def test_the_cheapest_apart_are_chosen_one_after_the_other():
    rng = np.random.default_rng(1)
    for count, more in ((3, 0.0), (3, 2.0), (400, 0.0)):
        points, cost = rng.uniform(-0.2, 0.2, (300, 3)), rng.uniform(0.0, 6.0, 300)
        cost[:20] = np.inf
        chosen = best_apart(cost, points, count, more, 0.1)
        left, expected = cost.copy(), []
        while np.isfinite(left.min()) and (len(expected) < count or left.min() < cost.min() + more):
            expected.append(int(np.argmin(left)))
            left[np.linalg.norm(points - points[expected[-1]], axis=1) < 0.1] = np.inf
        assert list(chosen) == expected
