"""The dynamically consistent inverse: its identities, and its bounds where a Jacobian loses rank."""

import numpy as np
import pytest
from arms import states

from saphari_drake.math.inverses import consistent_inverse
from saphari_drake.robots.dynamics import evaluate_dynamics

MAX_MASS = 50.0


def random_task(seed, m=3, n=7):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    return rng.normal(size=(m, n)), A @ A.T + 0.1 * np.eye(n), rng


@pytest.mark.parametrize("seed", range(20))
def test_identities_at_full_rank(seed):
    """J J^# = I, JP = 0, P² = P, P J^# = 0, M J^# = JᵀΛ, and P is self-adjoint in M: no inertial coupling."""
    J, M, _ = random_task(seed)
    Lambda, J_inv, P = consistent_inverse(J, M, 1e6)
    np.testing.assert_allclose(J @ J_inv, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(J @ P, 0.0, atol=1e-9)
    np.testing.assert_allclose(P @ P, P, atol=1e-9)
    np.testing.assert_allclose(P @ J_inv, 0.0, atol=1e-9)
    np.testing.assert_allclose(M @ J_inv, J.T @ Lambda, atol=1e-9)
    np.testing.assert_allclose(M @ P, (M @ P).T, atol=1e-8)
    np.testing.assert_allclose(J @ np.linalg.solve(M, P.T @ M @ P), 0.0, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_least_kinetic_energy(seed):
    """Of all q̇ with Jq̇ = ẋ, J^#ẋ has the least kinetic energy."""
    J, M, rng = random_task(seed)
    _, J_inv, P = consistent_inverse(J, M, 1e6)
    v = J_inv @ rng.normal(size=3)
    for _ in range(10):
        other = v + P @ rng.normal(size=7)
        np.testing.assert_allclose(J @ other, J @ v, atol=1e-9)
        assert v @ M @ v <= other @ M @ other


@pytest.mark.parametrize("seed", range(5))
def test_rank_deficient_jacobian(seed):
    """A direction that J cannot move makes no torque; in the others the inverse stays exact."""
    J, M, rng = random_task(seed)
    u = rng.normal(size=3)
    u /= np.linalg.norm(u)
    tangent = np.eye(3) - np.outer(u, u)
    J = tangent @ J
    Lambda, J_inv, P = consistent_inverse(J, M, MAX_MASS)
    np.testing.assert_allclose(J @ J_inv, tangent, atol=1e-8)
    np.testing.assert_allclose(J_inv @ u, 0.0, atol=1e-8)
    np.testing.assert_allclose(J @ P, 0.0, atol=1e-8)
    np.testing.assert_allclose(u @ Lambda @ u, MAX_MASS)


def test_bounded_and_continuous_through_a_singularity():
    """Effective mass never exceeds its bound, and small changes of J make small changes of JᵀΛ."""
    J, M, _ = random_task(3)
    before = None
    for scale in np.linspace(-0.2, 0.2, 2001):
        J[2] = scale * np.ones(7)
        Lambda, J_inv, _ = consistent_inverse(J, M, MAX_MASS)
        eigenvalues = np.linalg.eigvalsh(Lambda)
        assert eigenvalues[0] > 0.0
        assert eigenvalues[-1] <= MAX_MASS * (1 + 1e-9)
        if before is not None:
            assert np.max(np.abs(M @ J_inv - before)) < 0.05
        before = M @ J_inv


def test_zero_jacobian_has_the_whole_null_space():
    _, M, _ = random_task(0)
    Lambda, J_inv, P = consistent_inverse(np.zeros((3, 7)), M, MAX_MASS)
    np.testing.assert_allclose(Lambda, MAX_MASS * np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(J_inv, 0.0)
    np.testing.assert_array_equal(P, np.eye(7))


def test_lwr4_link_3_has_no_radial_motion(lwr4):
    """Joints 1 to 3 meet in the shoulder: every point of link 3 moves on a sphere round it."""
    shoulder = np.array([0.0, 0.0, 0.3105])
    for q, v in states(lwr4, 20):
        terms = evaluate_dynamics(lwr4, q, v)
        point = terms.point(2, np.array([0.03, 0.05, 0.1]))
        radial = (point.p_WC - shoulder) / np.linalg.norm(point.p_WC - shoulder)
        np.testing.assert_allclose(radial @ point.Jv_WC, 0.0, atol=1e-12)
        Lambda, J_inv, _ = consistent_inverse(point.Jv_WC, terms.M, MAX_MASS)
        assert np.linalg.eigvalsh(Lambda)[-1] <= MAX_MASS * (1 + 1e-9)
        np.testing.assert_allclose(J_inv @ radial, 0.0, atol=1e-9)
