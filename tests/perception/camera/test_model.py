"""Where a camera looks, and which way is up in its image."""

import numpy as np
import pytest

from saphari_drake.perception.camera.model import CameraParameters, camera_pose, ray_tables


@pytest.mark.parametrize("position", [[1.0, -0.5, 1.4], [-1.0, 2.0, 0.2]])
def test_it_looks_at_its_target_with_the_floor_below(position):
    params = CameraParameters(position=position, target=[0.1, 0.2, 0.6])
    X_WC = camera_pose(params)
    p_CT = X_WC.inverse() @ np.array(params.target)
    np.testing.assert_allclose(p_CT[:2], 0.0, atol=1e-12)
    assert p_CT[2] > 0.0
    lower, to_the_right = (X_WC.rotation().matrix()[:, axis] for axis in (1, 0))
    assert lower[2] < 0.0 and abs(to_the_right[2]) < 1e-12


def test_rays_rise_with_columns_and_rows():
    x, y = ray_tables(CameraParameters())
    assert np.all(np.diff(x) > 0.0) and np.all(np.diff(y) > 0.0) and x[0] < 0.0 < x[-1]
