"""How near people are, and how fast the robot goes towards them."""

import numpy as np

from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.nearness import balls_of, fastest_end, pair, posed, surface_of, towards


def test_the_speed_towards_a_person_is_the_rate_of_the_distance(lwr4):
    """Finite differences of the distance, for every shape."""
    rng, surface, h = np.random.default_rng(3), surface_of(lwr4), 1e-6
    for _ in range(5):
        q, v, ball = lwr4.home + rng.uniform(-0.3, 0.3, 7), rng.uniform(-1, 1, 7), rng.uniform(0.5, 1.0, 3)
        motion = lwr4.kinematics(q).motion
        ahead, behind = (posed(surface, lwr4.kinematics(q + t * v).motion) for t in (h, -h))
        row = np.empty(7)
        for s in range(len(surface.link)):
            _, p_WN, u = pair(surface, posed(surface, motion), s, ball)
            towards(motion, surface.link[s], p_WN, u, row)
            rate = (pair(surface, ahead, s, ball)[0] - pair(surface, behind, s, ball)[0]) / (2 * h)
            np.testing.assert_allclose(row @ v, -rate, atol=1e-5)


def test_shapes_are_posed_as_the_model_poses_them(lwr4):
    terms, surface = evaluate_dynamics(lwr4, lwr4.home + 0.2, np.zeros(7)), surface_of(lwr4)
    R, p = lwr4.shapes.in_world(terms.R_WL, terms.p_WL)
    moving = lwr4.shapes.link >= 0
    for given, expected in zip(posed(surface, terms.motion), (R[moving], p[moving])):
        np.testing.assert_allclose(given, expected, atol=1e-12)


def test_the_fastest_end_is_proportional_to_the_speed(lwr4):
    v, surface = np.array([0.5, -0.3, 0.2, 0.4, 0.0, 0.1, 0.9]), surface_of(lwr4)
    motion = lwr4.kinematics(lwr4.home).motion
    assert fastest_end(surface, motion, 0.0 * v) == 0.0
    np.testing.assert_allclose(fastest_end(surface, motion, 2.0 * v), 2.0 * fastest_end(surface, motion, v))


def test_people_that_cannot_be_used_are_none():
    good = ObstaclePoints(np.ones((2, 3)), np.zeros((2, 3)), np.zeros(2), 0.0)
    assert balls_of(good) is not None
    for bad in (
        ObstaclePoints(status=ObstacleStatus.LOST),
        ObstaclePoints(np.ones((2, 3)), np.zeros((1, 3)), np.zeros(2)),
        ObstaclePoints(np.full((1, 3), np.nan), np.zeros((1, 3)), np.zeros(1)),
        ObstaclePoints(np.ones((1, 3)), np.zeros((1, 3)), np.array([-1.0])),
    ):
        assert balls_of(bad) is None
