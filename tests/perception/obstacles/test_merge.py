"""What several cameras see, joined."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.perception.obstacles.merge import MergedObstacles


def seen(count, stamp, status=ObstacleStatus.OK):
    return ObstaclePoints(np.full((count, 3), stamp), np.zeros((count, 3)), np.full(count, 0.1), stamp, status)


def test_all_points_as_old_as_the_oldest():
    b = Bench(MergedObstacles(2), obstacles_0=seen(2, 0.3), obstacles_1=seen(3, 0.2, ObstacleStatus.HELD))
    joined = b.read("obstacles")
    assert (len(joined.p_WO), joined.stamp, joined.status) == (5, 0.2, ObstacleStatus.HELD)
    assert b.read("status") == ObstacleStatus.HELD


def test_one_that_is_lost_loses_all():
    b = Bench(MergedObstacles(2), obstacles_0=seen(2, 0.3), obstacles_1=ObstaclePoints(status=ObstacleStatus.LOST))
    assert b.read("obstacles").status == ObstacleStatus.LOST and len(b.read("obstacles").p_WO) == 0


def test_none_at_all_is_told():
    with pytest.raises(ParameterError, match="count"):
        MergedObstacles(0)
