"""A limb is fitted and its contact found: against exact limbs, a plain twin, noise and readings of other things."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from saphari_drake.math.primitives import CAPSULE, Primitives
from saphari_drake.perception.contact import limb as kernels

# One link: a capsule along y before the camera at 1.5 m.
SHAPES = Primitives(
    np.array([CAPSULE]), np.array([[0.06, 0.3, 0.0]]), np.array([2]), np.array([[[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]]),
    np.array([[0.0, 0.0, 1.5]]),
)  # fmt: skip


def near_side(c, u, radius, rng, half=0.12, count=400, sigma=0.0):
    """Readings of the side of a cylinder that faces the camera at the origin."""
    points = []
    while len(points) < count:
        n = np.cross(u, rng.normal(size=3))
        n /= np.linalg.norm(n)
        p = c + rng.uniform(-half, half) * u + radius * n
        if n @ p < -0.2 * np.linalg.norm(p):
            points.append(p * (1.0 + sigma * rng.normal() / np.linalg.norm(p)))
    return np.array(points)


def direction(rng):
    u = rng.normal(size=3) * [1.0, 1.0, 0.4]
    return u / np.linalg.norm(u)


@pytest.mark.parametrize("seed", range(5))
def test_exact_limb_is_found(seed):
    rng = np.random.default_rng(seed)
    u, c, radius = direction(rng), np.array([0.05, -0.1, 1.4]), rng.uniform(0.03, 0.05)
    c_fit, u_fit, radius_fit, first, last = kernels.fit_limb(near_side(c, u, radius, rng))
    assert abs(u_fit @ u) > 1.0 - 1e-4
    off = c_fit - c
    assert np.linalg.norm(off - (off @ u) * u) < 0.002
    assert radius_fit == pytest.approx(radius, abs=0.002)
    assert last - first == pytest.approx(0.24, abs=0.02)


def twin(points, start):
    """The same robust fit by SciPy in float64: axis through (x, y) of a plane, two slopes, radius."""
    middle = points.mean(axis=0)
    U = np.linalg.eigh(np.cov((points - middle).T))[1]
    basis = np.column_stack([U[:, 0], U[:, 1], U[:, 2]])

    def residuals(x):
        axis = basis @ np.array([x[2], x[3], 1.0])
        axis /= np.linalg.norm(axis)
        w = points - (middle + basis[:, :2] @ x[:2])
        return np.append(np.linalg.norm(w - np.outer(w @ axis, axis), axis=1) - x[4], 0.0)

    behind = basis[:, :2].T @ (0.7 * start * middle / np.linalg.norm(middle))
    best = least_squares(residuals, [*behind, 0.0, 0.0, start], loss="cauchy", f_scale=0.004)
    axis = basis @ np.array([best.x[2], best.x[3], 1.0])
    return middle + basis[:, :2] @ best.x[:2], axis / np.linalg.norm(axis), best.x[4]


@pytest.mark.parametrize("seed", range(4))
def test_fit_equals_its_plain_twin(seed):
    rng = np.random.default_rng(20 + seed)
    u, c = direction(rng), np.array([0.05, -0.1, 1.4])
    points = near_side(c, u, 0.04, rng, sigma=0.001)
    c_fit, u_fit, radius_fit, _, _ = kernels.fit_limb(points)
    c_twin, u_twin, radius_twin = twin(points, 0.04)
    off = c_fit - c_twin
    assert np.linalg.norm(off - (off @ u_twin) * u_twin) < 0.001
    assert abs(u_fit @ u_twin) > 1.0 - 1e-5
    assert radius_fit == pytest.approx(radius_twin, abs=0.001)


def test_noise_and_readings_of_other_things_move_it_little():
    rng = np.random.default_rng(7)
    u, c = direction(rng), np.array([0.0, 0.0, 1.4])
    points = near_side(c, u, 0.04, rng, sigma=0.003)
    points[:30] += rng.uniform(-0.06, 0.06, (30, 3))
    c_fit, u_fit, radius, _, _ = kernels.fit_limb(points)
    off = c_fit - c
    assert abs(u_fit @ u) > 0.99
    assert np.linalg.norm(off - (off @ u) * u) < 0.008
    assert radius == pytest.approx(0.04, abs=0.008)


@pytest.mark.parametrize("angle", [90.0, 45.0])
def test_side_of_a_limb_touches_where_it_crosses_the_link(angle):
    turn = np.deg2rad(angle)
    u = np.array([np.sin(turn), np.cos(turn), 0.0])
    c = np.array([0.0, 0.07, 1.5 - 0.06 - 0.04]) + 0.03 * u
    link, p, d = kernels.limb_contact(SHAPES, kernels.Limb(c, u, 0.04, -0.12, 0.12), 0.003)
    assert link == 2
    assert d == pytest.approx(0.04, abs=1e-4)
    np.testing.assert_allclose(p, [0.0, 0.07, 1.44], atol=2e-3)


def test_end_of_a_limb_goes_on_until_it_touches():
    u = np.array([0.0, 0.0, 1.0])
    c = np.array([0.0, 0.05, 1.2])
    link, p, d = kernels.limb_contact(SHAPES, kernels.Limb(c, u, 0.04, -0.1, 0.22), 0.003)
    assert link == 2
    assert d == pytest.approx(0.04, abs=1e-3)
    np.testing.assert_allclose(p, [0.0, 0.05, 1.44], atol=1e-3)


def test_limb_far_away_does_not_touch():
    u = np.array([0.0, 0.0, 1.0])
    _, _, d = kernels.limb_contact(SHAPES, kernels.Limb(np.array([0.0, 0.0, 1.0]), u, 0.04, -0.1, 0.1), 0.003)
    assert d > 0.2


def test_readings_around_a_point_are_those_within_the_radius_and_not_too_many():
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.3, 0.3, (4000, 3))
    chosen = kernels.readings_around(points, np.zeros(3), 0.12, 50)
    assert 25 < len(chosen) <= 51
    assert np.all(np.linalg.norm(chosen, axis=1) < 0.12)
    assert len(kernels.readings_around(points, np.full(3, 5.0), 0.12, 50)) == 0
