"""The nearest point within limits: the same as DAQP's, and said not to exist where there is none."""

import daqp
import numpy as np
import pytest

from saphari_drake.safety.joint_envelope.nearest import nearest

N = 7


def problem(seed, shifted=False):
    """Return metric, wish and limits with a point inside; limits that are shifted at random may have none."""
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(N, N))
    H = (B @ B.T + 0.1 * np.eye(N)) * 10.0 ** rng.uniform(-2.0, 2.0)
    C = np.vstack([np.eye(N), H, rng.normal(size=(1, N))])
    width = rng.uniform(0.0, 1.0, len(C)) * 10.0 ** rng.uniform(-1.0, 2.0)
    inside = C @ rng.normal(size=N)
    low, high = inside - width * rng.uniform(size=len(C)), inside + width * rng.uniform(size=len(C))
    if shifted:
        low = low + rng.uniform(0.0, 1.0, len(C)) * (rng.random(len(C)) < 0.2) * width
        high = np.maximum(high, low)
    return H, rng.normal(size=N) * 10.0 ** rng.uniform(0.0, 3.0), C, low, high


def solved(H, wish, C, low, high):
    x, active = np.empty(N), np.empty(len(low), dtype=np.int64)
    return nearest(np.linalg.inv(H), wish, C, low, high, x, active), x, active


@pytest.mark.parametrize("seed", range(300))
def test_it_is_the_point_that_daqp_finds(seed):
    H, wish, C, low, high = problem(seed)
    found, x, active = solved(H, wish, C, low, high)
    assert found
    twin, _, flag, _ = daqp.solve(H, -H @ wish, C, high, low, np.zeros(len(low), dtype=np.int32), primal_tol=1e-10)
    assert flag == 1
    error, scale = x - twin, wish - twin
    assert error @ H @ error < 1e-10 * (1.0 + scale @ H @ scale)
    y = C @ x
    np.testing.assert_allclose(y[active > 0], high[active > 0], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(y[active < 0], low[active < 0], rtol=1e-8, atol=1e-8)


def test_limits_that_contradict_one_another_are_told():
    disagree = 0
    for seed in range(300):
        H, wish, C, low, high = problem(1000 + seed, shifted=True)
        found, x, _ = solved(H, wish, C, low, high)
        flag = daqp.solve(H, -H @ wish, C, high, low, np.zeros(len(low), dtype=np.int32))[2]
        assert found == (flag == 1)
        disagree += not found
        if found:
            assert np.all(C @ x <= high + 1e-8 * (1.0 + np.abs(high)))
            assert np.all(C @ x >= low - 1e-8 * (1.0 + np.abs(low)))
    assert 30 < disagree < 270


def test_a_wish_within_limits_is_left_alone():
    H, wish, C, _, _ = problem(1)
    found, x, active = solved(H, wish, C, C @ wish - 1.0, C @ wish + 1.0)
    assert found and not active.any()
    np.testing.assert_array_equal(x, wish)
