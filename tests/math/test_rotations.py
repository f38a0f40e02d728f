"""Rotations: identities of SO(3), and agreement with Drake."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RotationMatrix

from saphari_drake.math.rotations import (
    axis_rotation,
    rotation_between,
    rotation_exp,
    rotation_log,
    rotation_rate,
    skew,
)

VECTORS = st.tuples(*[st.floats(-10.0, 10.0)] * 3).map(np.array).filter(lambda a: np.linalg.norm(a) > 1e-3)
ANGLES = st.floats(-10.0, 10.0)


def assert_rotation(R):
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@given(VECTORS, VECTORS)
def test_skew_is_the_cross_product(w, a):
    np.testing.assert_allclose(skew(w) @ a, np.cross(w, a), atol=1e-12)
    np.testing.assert_array_equal(skew(w), -skew(w).T)


@given(VECTORS, ANGLES)
def test_axis_rotation_equals_drakes(axis, angle):
    axis = axis / np.linalg.norm(axis)
    R = axis_rotation(axis, angle)
    np.testing.assert_allclose(R, RotationMatrix(AngleAxis(angle, axis)).matrix(), atol=1e-12)
    assert_rotation(R)
    np.testing.assert_allclose(R @ axis, axis, atol=1e-12)


@given(VECTORS, VECTORS)
def test_rotation_between_is_the_shortest_that_aligns(a, b):
    """R a points along b, and R turns by the angle between them, no more."""
    R = rotation_between(a, b)
    assert_rotation(R)
    unit_a, unit_b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    np.testing.assert_allclose(R @ unit_a, unit_b, atol=1e-9)
    assert np.trace(R) == pytest.approx(1.0 + 2.0 * unit_a @ unit_b, abs=1e-9)


@given(VECTORS)
def test_rotation_between_opposite_and_equal_directions(a):
    np.testing.assert_allclose(rotation_between(a, 3.0 * a), np.eye(3), atol=1e-9)
    half_turn = rotation_between(a, -a)
    assert_rotation(half_turn)
    np.testing.assert_allclose(half_turn @ a, -a, atol=1e-9)


def test_rotation_between_nearly_opposite_directions():
    """No loss of accuracy just beside the special case."""
    a = np.array([0.3, -0.5, 0.8])
    for offset in (1e-6, 1e-9, 1e-11, 1e-13):
        b = -a + offset * np.array([1.0, 0.0, 0.0])
        R = rotation_between(a, b)
        assert_rotation(R)
        np.testing.assert_allclose(R @ a, b * np.linalg.norm(a) / np.linalg.norm(b), atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 1e-3, 1.0, 3.0, np.pi - 1e-7, np.pi])
def test_log_is_the_turn_up_to_half_a_turn(angle):
    """About an axis that is none of the coordinate axes; at half a turn either sign will do."""
    e = angle * np.array([0.6, -0.48, 0.64])
    found = rotation_log(rotation_exp(e))
    sign = np.sign(found @ e) if angle > 3.14 else 1.0
    np.testing.assert_allclose(found, sign * e, atol=1e-6)


@given(VECTORS)
def test_exp_equals_drakes_and_log_undoes_it(e):
    """The rotation vector of exp(e) is e up to whole turns."""
    angle = np.linalg.norm(e)
    R = rotation_exp(e)
    np.testing.assert_allclose(R, RotationMatrix(AngleAxis(angle, e / angle)).matrix(), atol=1e-12)
    np.testing.assert_allclose(rotation_exp(rotation_log(R)), R, atol=1e-9)


@given(VECTORS, VECTORS, VECTORS)
def test_rate_of_the_log_is_its_derivative(e, w_desired, w):
    """d/dt log(R_d Rᵀ) by central differences, for turns of less than three quarters of π."""
    e, h = e / np.linalg.norm(e) * (0.75 * np.pi * np.tanh(np.linalg.norm(e))), 1e-6

    def turned(t):
        return rotation_log(rotation_exp(w_desired * t) @ rotation_exp(e) @ rotation_exp(w * t).T)

    expected = (turned(h) - turned(-h)) / (2 * h)
    np.testing.assert_allclose(rotation_rate(e, w_desired, w), expected, atol=1e-6 * (1 + np.abs(expected).max()))
