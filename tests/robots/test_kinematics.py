"""Positions and Jacobians of points, from the robot alone and from its dynamics."""

import numpy as np
import pytest

from saphari_drake.errors import StateError
from saphari_drake.robots.dynamics import evaluate_dynamics

POINT = np.array([0.03, -0.05, 0.1])


@pytest.fixture(params=range(3))
def state(lwr4, request):
    rng = np.random.default_rng(request.param)
    return rng.uniform(lwr4.q_min, lwr4.q_max), rng.uniform(-1.0, 1.0, 7)


@pytest.mark.parametrize("link", range(7))
def test_a_point_is_where_its_link_puts_it_and_back_again(lwr4, state, link):
    at = lwr4.kinematics(*state)
    np.testing.assert_allclose(at.position(link, POINT), at.point(link, POINT).p_WC, atol=1e-15)
    np.testing.assert_allclose(at.in_link(link, at.position(link, POINT)), POINT, atol=1e-15)


def test_kinematics_are_those_of_the_dynamics(lwr4, state):
    at, terms = lwr4.kinematics(*state), evaluate_dynamics(lwr4, *state)
    for name in ("R_WL", "p_WL", "S", "V", "A", "parent"):
        np.testing.assert_array_equal(getattr(at, name), getattr(terms, name))


def test_jacobian_and_its_rate_by_differences(lwr4, state):
    """v = J q̇ and J̇q̇, along the motion."""
    (q, v), h = state, 1e-6
    point, ahead, behind = (lwr4.kinematics(q + s * h * v, v).point(6, POINT) for s in (0.0, 1.0, -1.0))
    np.testing.assert_allclose(point.v_WC, (ahead.p_WC - behind.p_WC) / (2 * h), atol=1e-7)
    np.testing.assert_allclose(point.v_WC, point.Jv_WC @ v, atol=1e-12)
    np.testing.assert_allclose(point.Jdotv_WC, (ahead.Jv_WC - behind.Jv_WC) @ v / (2 * h), atol=1e-6)


def test_at_rest_by_default(lwr4, state):
    at = lwr4.kinematics(state[0])
    np.testing.assert_array_equal(at.V, 0.0)
    np.testing.assert_array_equal(at.point(6, POINT).v_WC, 0.0)


def test_states_of_a_wrong_size_are_refused(lwr4):
    with pytest.raises(StateError, match="7 joints"):
        lwr4.kinematics(np.zeros(6))
    with pytest.raises(StateError, match="7 joints"):
        lwr4.kinematics(lwr4.home, np.zeros(8))


def test_a_state_that_is_not_known_has_no_kinematics(lwr4):
    """Nothing that is measured may raise in a control cycle."""
    assert np.isnan(lwr4.kinematics(np.full(7, np.nan)).point(6, POINT).p_WC).all()
