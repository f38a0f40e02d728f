"""What residuals teach about masses, tool and offsets."""

import numpy as np

from saphari_drake.estimation.model_error_law import counted, forgotten, learn, prior, sensitivity
from saphari_drake.robots.dynamics import evaluate_dynamics


def setup(robot, offset=0.3):
    start = prior(7, 0.05, 0.5, 0.1, np.full(7, offset))
    limits = 3.0 * np.sqrt(np.diag(start.covariance))
    return start, limits, np.zeros(len(limits))


def H_at(robot, q):
    return sensitivity(evaluate_dynamics(robot, q, np.zeros(7)).motion, robot.tree)


def test_what_is_learned_is_that_of_least_squares_with_the_prior(lwr4):
    start, limits, drift = setup(lwr4)
    rng, variance = np.random.default_rng(0), np.full(7, 0.01)
    theta = 0.5 * rng.normal(size=18) * np.sqrt(np.diag(start.covariance))
    now, A, b = start, np.linalg.inv(start.covariance), np.zeros(18)
    for _ in range(20):
        H = H_at(lwr4, rng.uniform(-1.5, 1.5, 7))
        r = H @ theta + 0.1 * rng.normal(size=7)
        now = learn(now, H, r, variance, drift, limits)
        A, b = A + H.T @ H / 0.01, b + H.T @ r / 0.01
    np.testing.assert_allclose(now.theta, np.linalg.solve(A, b), atol=1e-9)
    np.testing.assert_allclose(now.covariance, np.linalg.inv(A), atol=1e-9)
    assert not now.limited


def test_one_posture_teaches_that_posture_alone(lwr4):
    """There the uncertainty is gone; at another one it is not, and the truth lies within it."""
    start, limits, drift = setup(lwr4)
    theta = np.concatenate([np.full(7, 0.05), [0.5, 0.0, 0.0, 0.025], np.zeros(7)])
    here, there = H_at(lwr4, lwr4.home), H_at(lwr4, lwr4.home + 0.6)
    now = start
    for _ in range(200):
        now = learn(now, here, here @ theta, np.full(7, 0.01), drift, limits)
    np.testing.assert_allclose(here @ now.theta, here @ theta, atol=0.02)
    deviation = lambda H: np.sqrt(np.diag(H @ now.covariance @ H.T))  # noqa: E731
    assert np.all(deviation(here) < 0.01) and np.max(deviation(there)) > 0.3
    assert np.all(np.abs(there @ (now.theta - theta)) < 3.0 * deviation(there) + 1e-6)


def test_limits_hold_and_are_told(lwr4):
    start, limits, drift = setup(lwr4)
    H = H_at(lwr4, lwr4.home)
    now = start
    for _ in range(50):
        now = learn(now, H, np.full(7, 100.0), np.full(7, 0.01), drift, limits)
        assert np.all(np.abs(now.theta) <= limits)
    assert now.limited


def test_without_a_prior_nothing_is_learned(lwr4):
    start = prior(7, 0.0, 0.0, 0.0, np.zeros(7))
    now = learn(start, H_at(lwr4, lwr4.home), np.ones(7), np.full(7, 0.01), np.zeros(18), np.zeros(18))
    np.testing.assert_array_equal(now.theta, 0.0)


def test_what_is_forgotten_of_an_offset_is_learned_as_fast_as_at_first(lwr4):
    start, limits, drift = setup(lwr4)
    H, variance, r = H_at(lwr4, lwr4.home), np.full(7, 0.01), np.full(7, 0.2)
    now = start
    for _ in range(100):
        now = learn(now, H, r, variance, drift, limits)
    lost = forgotten(now, np.ones(7), np.full(7, 0.3))
    np.testing.assert_array_equal(lost.theta, now.theta)
    np.testing.assert_allclose(lost.covariance[11:, 11:], 0.09 * np.eye(7))
    np.testing.assert_array_equal(lost.covariance[11:, :11], 0.0)
    deviation = lambda of: np.sqrt(np.diag(H @ of.covariance @ H.T))  # noqa: E731
    assert np.all(deviation(now) < 0.05) and np.all(deviation(lost) > 0.299)
    assert np.linalg.eigvalsh(forgotten(now, np.full(7, 0.4), np.full(7, 0.3)).covariance)[0] > -1e-12
    again = learn(lost, H, r + 0.2, variance, drift, limits)
    assert np.all(H @ (again.theta - now.theta) > 0.15)
    stands = forgotten(now, np.zeros(7), np.full(7, 0.3))
    np.testing.assert_array_equal(stands.covariance, now.covariance)


def test_flicker_is_no_way():
    q, place = np.zeros(1), np.zeros(1)
    for k in range(100):
        place = counted(place, q + 0.0009 * (-1.0) ** k, 0.001)
    assert place[0] == 0.0
    assert counted(place, np.array([0.5]), 0.001)[0] == 0.499
