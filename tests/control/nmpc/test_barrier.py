"""The barrier and its sums over many obstacles."""

import numpy as np
import pytest

from saphari_drake.control.nmpc.barrier import barrier, barrier_sums, pseudo_huber
from saphari_drake.control.nmpc.rows import clearance, length, shortfalls, surplus

GUARD = 1e-3


def test_the_barrier_goes_on_smoothly_below_its_guard():
    """Value, slope and curvature are continuous, and the derivatives those of the value, on both sides."""
    above, below = barrier(GUARD * (1.0 + 1e-9), GUARD), barrier(GUARD * (1.0 - 1e-9), GUARD)
    assert below == pytest.approx(above, rel=1e-7)
    for s in (0.3 * GUARD, -2.0 * GUARD, 5.0 * GUARD):
        h = 1e-4 * GUARD
        _, slope, curvature = barrier(s, GUARD)
        assert slope == pytest.approx((barrier(s + h, GUARD)[0] - barrier(s - h, GUARD)[0]) / (2.0 * h), rel=1e-5)
        assert curvature == pytest.approx((barrier(s + h, GUARD)[1] - barrier(s - h, GUARD)[1]) / (2.0 * h), rel=1e-5)


def test_the_pseudo_huber_cost_is_convex_in_the_error_and_grows_linearly_far_away():
    """Its derivatives are those of the value; near zero it is s, far away 2σ^½ times the root of s; σ = 0 leaves s."""
    sigma = 0.04
    for s in (1e-6, 0.03, 5.0):
        h = 1e-4 * s
        _, slope, curve = pseudo_huber(s, sigma)
        assert slope == pytest.approx(
            (pseudo_huber(s + h, sigma)[0] - pseudo_huber(s - h, sigma)[0]) / (2.0 * h), rel=1e-6
        )
        assert curve == pytest.approx(
            (pseudo_huber(s + h, sigma)[1] - pseudo_huber(s - h, sigma)[1]) / (2.0 * h), rel=1e-5
        )
        assert 2.0 * slope + 4.0 * curve * s > 0.0  # second derivative along the error, s its square
    assert pseudo_huber(1e-9, sigma)[0] == pytest.approx(1e-9, rel=1e-6)
    assert pseudo_huber(1e6, sigma)[0] == pytest.approx(2.0 * np.sqrt(sigma * 1e6), rel=1e-3)
    assert pseudo_huber(0.7, 0.0) == (0.7, 1.0, 0.0)


@pytest.mark.parametrize("count", [1, 3, 16, 61])
def test_sums_over_many_obstacles_are_those_of_one_by_one(count):
    rng = np.random.default_rng(count)
    p, obstacles, radius = rng.normal(size=3), 3.0 * rng.normal(size=(3, count)), rng.uniform(0.0, 0.1, count)
    d = p[:, None] - obstacles
    s = np.sum(d**2, axis=0) - (0.2 + radius) ** 2
    psi = np.array([barrier(x, -np.inf) for x in s]).T
    sums = np.zeros(11)
    assert barrier_sums(obstacles, radius, p, 0.2, GUARD, sums) == np.sum(s < GUARD)
    assert sums[:2] == pytest.approx([psi[0].sum(), -psi[1].sum()], rel=1e-10)
    assert sums[2:5] == pytest.approx(-d @ psi[1], rel=1e-10)
    S = 0.5 * (d * psi[2]) @ d.T
    assert sums[5:] == pytest.approx([S[0, 0], S[1, 1], S[2, 2], S[0, 1], S[0, 2], S[1, 2]], rel=1e-10)


@pytest.mark.parametrize(("k", "swept"), [(1, True), (2, True), (1, False)])
def test_what_many_rows_leave_out_cannot_become_active(k, swept):
    """No row is left out that `clearance` with its gradients keeps, few more are kept, and Σ max(0, −z) agrees."""
    rng = np.random.default_rng(k)
    kept_rows = left_out = 0
    for _ in range(200):
        ends = rng.normal(size=3) + 0.1 * rng.normal(size=(2, 3))
        obstacles = rng.normal(size=(1, 3, 40)) + 0.1 * rng.normal(size=(2, 3, 40))
        radius, rho, out = rng.uniform(0.0, 0.3, 40), rng.uniform(0.0, 0.2, 2), np.empty(40)
        surplus((ends[0], ends[1]), (obstacles[0], obstacles[1]), 0.2, radius, (rho[0], rho[1]), k, swept, out)
        short = 0.0
        for o in range(40):
            a, b = ends[0] - obstacles[0, :, o], ends[1] - obstacles[1, :, o]
            value, from_a, from_b = clearance(a, b, 0.2 + radius[o], k, swept)
            active = value <= length(from_a) * rho[0] + length(from_b) * rho[1]
            assert not (active and out[o] > 0.0)
            kept_rows, left_out = kept_rows + (out[o] <= 0.0), left_out + (not active)
            short += max(0.0, -value)
        if not (swept and k == 1):
            pairs = (ends[0], ends[1]), (obstacles[0], obstacles[1])
            assert shortfalls(*pairs, 0.2, radius, 0.25 if swept else 0.0) == pytest.approx(short, rel=1e-10)
    assert kept_rows < 640 and left_out > 7000
