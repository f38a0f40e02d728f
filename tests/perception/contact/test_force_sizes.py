"""Forces whose sizes nobody knows: each size is found from the residual, in its cone, as the Gaussian model has it."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from saphari_drake.perception.contact.force_sizes import UsualForce, forces_of_any_size, size_costs

SIZES = np.geomspace(1.0, 200.0, 9)
USUAL = UsualForce(SIZES, 0.3, 0.25, 0.5)


@pytest.fixture
def contacts():
    rng = np.random.default_rng(4)
    inward = rng.normal(size=(2, 3))
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return 0.4 * rng.normal(size=(2, 3, 7)), inward


def leaning(inward, sizes):
    """Forces of these sizes that lean a little."""
    side = np.cross(inward, [0.3, 0.4, 0.5])
    F = inward + 0.2 * side / np.linalg.norm(side, axis=1, keepdims=True)
    return F / np.linalg.norm(F, axis=1, keepdims=True) * np.asarray(sizes)[:, None]


def test_costs_are_those_of_the_gaussian_model(contacts):
    J, inward = contacts
    r, sigma, point = np.linspace(-2.0, 3.0, 7), np.full(7, 0.2), np.full(7, 0.003)
    cost, sizes = size_costs(J, r, inward, SIZES, 0.3, 0.25, sigma, point)
    expected = []
    for s in sizes:
        mean, V = np.zeros(7), np.diag(sigma**2 + point**2 * np.mean(s**2))
        for k in range(2):
            N = np.outer(inward[k], inward[k])
            mean += s[k] * J[k].T @ inward[k]
            V += s[k] ** 2 * J[k].T @ (0.3**2 * N + 0.25**2 * (np.eye(3) - N)) @ J[k]
        expected.append(-2.0 * multivariate_normal(mean, V).logpdf(r) - 7.0 * np.log(2.0 * np.pi))
    assert len(cost) == 81
    np.testing.assert_allclose(cost, expected, rtol=1e-9)


@pytest.mark.parametrize("sizes", [(3.0, 80.0), (70.0, 5.0), (12.0, 12.0)])
def test_forces_of_any_size_are_found(contacts, sizes):
    J, inward = contacts
    true = leaning(inward, sizes)
    r = sum(J[k].T @ true[k] for k in range(2))
    found = forces_of_any_size(J, r, inward, USUAL, np.full(7, 0.02), np.zeros(7))
    error, size = np.linalg.norm(found - true, axis=1), np.linalg.norm(true, axis=1)
    assert np.all(error < 0.05 * size + 0.005 * np.sum(size))


def test_twice_the_residual_is_twice_the_force(contacts):
    """Up to the few sizes that are weighed; also where the residual shows the forces in part."""
    J, inward = contacts
    J = J[:, :, :4]
    r = sum(J[k].T @ leaning(inward, (10.0, 20.0))[k] for k in range(2))
    small, large = (
        forces_of_any_size(J, share * r, inward, USUAL, np.full(4, 0.05 * share), np.zeros(4)) for share in (1.0, 2.0)
    )
    np.testing.assert_allclose(large, 2.0 * small, atol=0.1 * np.abs(large).max())


def test_forces_lie_in_their_cones(contacts):
    J, inward = contacts
    for seed in range(20):
        r = 3.0 * np.random.default_rng(seed).normal(size=7)
        for F, a in zip(forces_of_any_size(J, r, inward, USUAL, np.full(7, 0.2), np.zeros(7)), inward):
            across = np.linalg.norm(F - (F @ a) * a)
            assert F @ a >= 0.0 and across <= 0.5 * (F @ a) + 1e-9


def test_one_contact_is_a_case_of_its_own(contacts):
    J, inward = contacts
    true = leaning(inward, (40.0, 1.0))[:1]
    found = forces_of_any_size(J[:1], J[0].T @ true[0], inward[:1], USUAL, np.full(7, 0.02), np.zeros(7))
    np.testing.assert_allclose(found, true, atol=0.5)
