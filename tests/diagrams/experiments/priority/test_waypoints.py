"""The path through waypoints."""

import numpy as np
import pytest
from experiments.priority.waypoints import WaypointPath

from saphari_drake.errors import ParameterError


def test_waypoint_velocity_is_the_derivative_and_rests_at_the_points():
    path = WaypointPath([[0, 0, 0], [1, 0, 0], [1, 2, 0]], 0.5, 1.0)
    assert path.arrivals == [3.0, 8.0]
    for t in (0.3, 1.0, 2.5, 3.5, 6.0, 7.5, 20.0):
        slope = (path(t + 1e-6)[0] - path(t - 1e-6)[0]) / 2e-6
        np.testing.assert_allclose(path(t)[1], slope, atol=1e-6)
    np.testing.assert_allclose(path(2.5)[0], [1.0, 0.0, 0.0])
    with pytest.raises(ParameterError, match="waypoints"):
        WaypointPath([[0, 0, 0]], 0.5, 1.0)
