"""A person who is faster, or comes in from outside: position and velocity belong together."""

import numpy as np
import pytest

from saphari_drake.messages import ObstaclePoints
from saphari_drake.simulation.faults.people import changed
from saphari_drake.simulation.world.profile import Truth


def person(time):
    return ObstaclePoints(
        np.array([[np.sin(time), 0.0, 1.0]]), np.array([[np.cos(time), 0.0, 0.0]]), np.array([0.1]), time
    )


@pytest.mark.parametrize("names", [["person_faster"], ["person_unseen"], ["person_faster", "person_unseen"]])
@pytest.mark.parametrize("time", [0.3, 1.2, 2.0, 4.0])
def test_velocity_is_the_derivative(names, time):
    at = changed(person, Truth(faults=dict.fromkeys(names, 1.0)), (-1.0, 0.0, 0.0))
    h = 1e-5
    rate = (at(time + h).p_WO - at(time - h).p_WO) / (2.0 * h)
    np.testing.assert_allclose(at(time).v_WO, rate, atol=1e-6)
    assert at(time).stamp == time


def test_who_comes_from_outside_is_away_before_and_there_after():
    at = changed(person, Truth(faults={"person_unseen": 1.0}), (-1.0, 0.0, 0.0))
    np.testing.assert_allclose(at(0.5).p_WO - person(0.5).p_WO, [[-3.0, 0.0, 0.0]])
    np.testing.assert_allclose(at(3.0).p_WO, person(3.0).p_WO)


def test_without_such_faults_nothing_changes():
    assert changed(person, Truth(faults={"torque_bias": 0.0}), (1.0, 0.0, 0.0)) is person
