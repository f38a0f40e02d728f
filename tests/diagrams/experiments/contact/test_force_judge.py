"""The drift that eq. (60) gives, against its closed form."""

from types import SimpleNamespace

import numpy as np
import pytest
from experiments.contact.force_judge import Drift, drift_metrics, expected_drift, free_drift_speed

from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.log import Log

PARAMS = ContactForceControlParameters(direction="fixed", fixed_force=[0.0, 15.0, 0.0])
LINK, POINT = 5, np.array([0.0, 0.072, 0.0])


def made_up_log(robot, transition, force, count=41, period=0.005):
    """A robot at rest whose contact point is felt with `force` and pushed on by the torque `transition`."""
    log = Log(period * np.arange(count))
    rows = {
        "position": robot.home,
        "velocity": np.zeros(robot.n),
        "active_link": [LINK],
        "contact_position": robot.kinematics(robot.home).position(LINK, POINT),
        "contact_truth": [*force, 0.0, 0.0, 0.0, LINK],
        "contact_force": force,
        "transition": transition,
    }
    for name, row in rows.items():
        log.add(name, np.tile(row, (count, 1)))
    return log, Drift(np.arange(count), np.zeros((count, 3)), True)


def test_without_resistance_it_is_the_closed_form_against_the_desired_force(lwr4):
    log, drift = made_up_log(lwr4, np.zeros(7), np.zeros(3))
    expected = free_drift_speed(15.0, 4.1, 10.5, 10.0, log.time[-1])
    np.testing.assert_allclose(expected_drift(log, lwr4, drift, PARAMS), [0.0, -expected, 0.0], rtol=5e-3, atol=1e-12)


def test_what_is_resisted_does_not_drift(lwr4):
    log, drift = made_up_log(lwr4, np.zeros(7), [0.0, 15.0, 0.0])
    np.testing.assert_allclose(expected_drift(log, lwr4, drift, PARAMS), 0.0, atol=1e-12)


def test_the_torque_of_the_handover_acts_on_the_natural_inertia(lwr4):
    """A constant one moves the contact by J M⁻¹ τ t, less what the damping takes."""
    torque = np.array([0.0, 0.5, 0.0, -0.3, 0.0, 0.1, 0.0])
    log, drift = made_up_log(lwr4, torque, [0.0, 15.0, 0.0])
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    start = terms.point(LINK, POINT).Jv_WC @ np.linalg.solve(terms.M, torque)
    rate, time = 10.5 / 10.0, log.time[-1]
    expected = start * -np.expm1(-rate * time) / rate
    assert expected_drift(log, lwr4, drift, PARAMS) == pytest.approx(expected, rel=5e-3)


def test_before_the_drift_the_resisted_force_alone_is_judged(lwr4):
    """A run that ends after the first push."""
    log, _ = made_up_log(lwr4, np.zeros(7), [0.0, 14.8, 0.0], count=301)
    setup = SimpleNamespace(
        scenario=SimpleNamespace(system=SimpleNamespace(pipeline=SimpleNamespace(controller=PARAMS)))
    )
    (metric,) = drift_metrics(setup, log, [SimpleNamespace(push=Push("link_6", start=0.2, hold=1.0))])
    assert metric.name == "force_along_desired_error_N" and metric.value == pytest.approx(0.2)
