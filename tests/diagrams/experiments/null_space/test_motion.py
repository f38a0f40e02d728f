"""The straight motion of the experiments of Section 5."""

import numpy as np
import pytest
from experiments.null_space.motion import StraightMotionParameters, straight_motion
from pydrake.math import RigidTransform, RollPitchYaw


@pytest.mark.parametrize("pause", [0.0, 1.0])
def test_straight_motion_goes_there_and_back(pause):
    """Pose, velocity and acceleration agree by finite differences, all along two rounds; the orientation stays."""
    X = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.4, -0.1, 0.6])
    p = StraightMotionParameters(displacement=[0.1, 0.2, -0.1], pause=pause, period=1e-3)
    motion, h = straight_motion(X, p), 1e-5
    sample = motion._sample
    for t in (0.2, 1.0, 3.4, 3.9, 5.0, 8.0, 9.7, 12.0):
        now, after, before = sample(t), sample(t + h), sample(t - h)
        np.testing.assert_allclose(
            now["desired_velocity"][3:],
            (after["desired_pose"].translation() - before["desired_pose"].translation()) / (2 * h),
            atol=1e-6,
        )
        difference = (after["desired_velocity"] - before["desired_velocity"]) / (2 * h)
        np.testing.assert_allclose(now["desired_acceleration"], difference, atol=1e-4)
        np.testing.assert_array_equal(now["desired_pose"].rotation().matrix(), X.rotation().matrix())
    far = sample(p.start + p.travel_time)["desired_pose"].translation() - X.translation()
    np.testing.assert_allclose(far, p.displacement, atol=1e-12)
    back = sample(p.start + 2.0 * (p.travel_time + pause))["desired_pose"].translation()
    np.testing.assert_allclose(back, X.translation(), atol=1e-12)
