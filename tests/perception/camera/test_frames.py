"""Remembered postures: interpolation in time."""

import numpy as np

from saphari_drake.perception.camera.frames import sample_at


def test_posture_is_interpolated_and_holds_at_both_ends():
    postures = ((0.0, np.array([0.0, 1.0])), (0.1, np.array([1.0, -1.0])), (0.2, np.array([3.0, -1.0])))
    np.testing.assert_allclose(sample_at(postures, 0.05), [0.5, 0.0])
    np.testing.assert_allclose(sample_at(postures, 0.15), [2.0, -1.0])
    np.testing.assert_array_equal(sample_at(postures, -1.0), [0.0, 1.0])
    np.testing.assert_array_equal(sample_at(postures, 1.0), [3.0, -1.0])
