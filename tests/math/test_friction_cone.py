"""The force in the friction cone: against a plain search, inside the cone, and for two contacts."""

import numpy as np
import pytest
from scipy.optimize import minimize

from saphari_drake.math.friction_cone import expected_forces_in_cones, force_in_cone, tangents

MU = 0.5


def frame(a):
    t, u = np.empty(3), np.empty(3)
    tangents(a, t, u)
    return t, u


def unit(rng):
    a = rng.normal(size=3)
    return a / np.linalg.norm(a)


def inside(F, a, slack=1e-9):
    along = F @ a
    return np.linalg.norm(F - along * a) <= MU * along + slack


def twin(J, r, a, mu, rcond):
    """Least misfit over the cone by dense angles; plain numpy."""
    values, U = np.linalg.eigh(J @ J.T)
    kept = U[:, values > rcond**2 * values[-1]]
    H = kept @ np.diag(values[values > rcond**2 * values[-1]]) @ kept.T + 1e-6 * values[-1] * np.eye(3)
    b = kept @ kept.T @ (J @ r)
    t, u = frame(a)
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)
    d = a[:, None] + mu * (np.outer(t, np.cos(angle)) + np.outer(u, np.sin(angle)))
    size = np.maximum(b @ d, 0.0) / np.einsum("ik,ij,jk->k", d, H, d)
    cost = size**2 * np.einsum("ik,ij,jk->k", d, H, d) - 2.0 * size * (b @ d)
    boundary = size[np.argmin(cost)] * d[:, np.argmin(cost)]
    free = np.linalg.solve(H, b)
    return (free if inside(free, a, 0.0) else boundary), H, b


@pytest.mark.parametrize("seed", range(4))
def test_force_costs_no_more_than_the_plain_search(seed):
    rng = np.random.default_rng(seed)
    for _ in range(150):
        n = rng.integers(2, 8)
        J = rng.normal(size=(3, n)) * rng.uniform(0.01, 1.0, (3, 1))
        r, a = 5.0 * rng.normal(size=n), unit(rng)
        F = force_in_cone(J, r, a, MU, 0.02)
        plain, H, b = twin(J, r, a, MU, 0.02)

        def cost(f, H=H, b=b):
            return f @ H @ f - 2.0 * b @ f

        assert inside(F, a)
        assert cost(F) <= cost(plain) + 1e-6 * (1.0 + abs(cost(plain)))


def test_force_of_the_cone_is_found_exactly():
    rng = np.random.default_rng(5)
    for _ in range(50):
        J, a = rng.normal(size=(3, 7)), unit(rng)
        t, u = frame(a)
        F = 20.0 * (a + 0.45 * (np.cos(1.0) * t + np.sin(1.0) * u))
        np.testing.assert_allclose(force_in_cone(J, J.T @ F, a, MU, 0.002), F, atol=0.02)


def test_pull_gives_no_force():
    J, a = np.random.default_rng(6).normal(size=(3, 7)), np.array([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(force_in_cone(J, J.T @ (-10.0 * a), a, MU, 0.02), np.zeros(3))
    np.testing.assert_array_equal(force_in_cone(J, np.zeros(7), a, MU, 0.02), np.zeros(3))


def test_unseen_pressure_is_the_least_that_holds_the_friction():
    """A torque-free direction along the normal: the friction of 5 N that is seen needs 10 N of pressure."""
    J = np.zeros((3, 3))
    J[0, 0], J[1, 1] = 0.4, 0.3
    F = force_in_cone(J, np.array([0.4 * 5.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), MU, 0.02)
    np.testing.assert_allclose(F, [5.0, 0.0, 10.0], rtol=1e-3, atol=1e-6)


def test_force_is_continuous():
    rng = np.random.default_rng(8)
    J, a, direction = rng.normal(size=(3, 7)), unit(rng), rng.normal(size=7)
    r = rng.normal(size=7) * 5.0
    forces = np.array([force_in_cone(J, r + k * 1e-3 * direction, a, MU, 0.02) for k in range(4000)])
    assert np.linalg.norm(np.diff(forces, axis=0), axis=1).max() < 0.05


def test_two_forces_are_found_together():
    rng = np.random.default_rng(9)
    for _ in range(4):
        J, a = rng.normal(size=(2, 3, 7)), np.array([unit(rng), unit(rng)])
        true = np.array([15.0 * a[0] + 3.0 * frame(a[0])[0], 25.0 * a[1]])
        r = J[0].T @ true[0] + J[1].T @ true[1]
        F, misfit = expected_forces_in_cones(J, r, a, 20.0 * a, 0.01, 15.0, 6.0, MU)
        np.testing.assert_allclose(F, true, atol=0.2)
        np.testing.assert_allclose(J[0].T @ F[0] + J[1].T @ F[1], r, atol=0.02)
        assert misfit == pytest.approx(np.sum((r - J[0].T @ F[0] - J[1].T @ F[1]) ** 2) / 0.01**2)
        assert inside(F[0], a[0]) and inside(F[1], a[1])


@pytest.mark.parametrize("seed", range(3))
def test_two_forces_cost_least(seed):
    rng = np.random.default_rng(10 + seed)
    J, a = rng.normal(size=(2, 3, 7)), np.array([unit(rng), unit(rng)])
    r, mean, sigma, along, across = rng.normal(size=7) * 5.0, 20.0 * a, 0.5, 15.0, 6.0

    def cost(x):
        off = x.reshape(2, 3) - mean
        normal = np.sum(off * a, axis=1)
        beside = np.linalg.norm(off - normal[:, None] * a, axis=1)
        rest = r - J[0].T @ x[:3] - J[1].T @ x[3:]
        return rest @ rest / sigma**2 + np.sum((normal / along) ** 2 + (beside / across) ** 2)

    cones = [
        {"type": "ineq", "fun": lambda x, k=k: MU**2 * (x[3 * k : 3 * k + 3] @ a[k]) ** 2
         - np.sum((x[3 * k : 3 * k + 3] - (x[3 * k : 3 * k + 3] @ a[k]) * a[k]) ** 2)}
        for k in range(2)
    ] + [{"type": "ineq", "fun": lambda x, k=k: x[3 * k : 3 * k + 3] @ a[k]} for k in range(2)]  # fmt: skip
    best = minimize(cost, a.ravel(), method="SLSQP", constraints=cones, options={"maxiter": 500})
    F, _ = expected_forces_in_cones(J, r, a, mean, sigma, along, across, MU)
    assert cost(F.ravel()) <= best.fun + 1e-3


def test_a_force_that_makes_no_torque_is_as_expected():
    a, J = np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3, 7))
    J[0, :2, :2] = 0.3 * np.eye(2)
    F, _ = expected_forces_in_cones(J, np.array([1.2, 0, 0, 0, 0, 0, 0.0]), a, 20.0 * a, 0.05, 15.0, 6.0, MU)
    np.testing.assert_allclose(F[0], [4.0, 0.0, 20.0], atol=0.02)
