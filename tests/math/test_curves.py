"""The quintic: its ends, its slope, and that its derivatives are derivatives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from saphari_drake.math.curves import quintic


def test_it_goes_from_0_to_1_with_flat_ends():
    """Neither slope nor curvature at both ends, and beyond them it is constant."""
    a = np.array([-0.5, 0.0, 0.5, 1.0, 1.5])
    s, slope, curvature = quintic(a)
    np.testing.assert_array_equal(s, [0.0, 0.0, 0.5, 1.0, 1.0])
    np.testing.assert_array_equal(slope, [0.0, 0.0, 15.0 / 8.0, 0.0, 0.0])
    np.testing.assert_array_equal(curvature, np.zeros(5))


def test_it_is_steepest_in_the_middle():
    """Its slope never exceeds 15/8, and it only rises."""
    slope = quintic(np.linspace(-0.1, 1.1, 20001))[1]
    assert slope.min() >= 0.0 and slope.max() == pytest.approx(15.0 / 8.0)


@given(st.floats(0.01, 0.99))
def test_its_derivatives_are_derivatives(a):
    """By central differences; a number gives the same as an array."""
    before, here, after = (quintic(a + h) for h in (-1e-6, 0.0, 1e-6))
    assert here[1] == pytest.approx((after[0] - before[0]) / 2e-6, abs=1e-7)
    assert here[2] == pytest.approx((after[1] - before[1]) / 2e-6, abs=1e-7)
    np.testing.assert_array_equal(np.array(quintic(np.array([a])))[:, 0], here)
