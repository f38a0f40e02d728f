"""Remembered postures: interpolation in time, and link poses as everywhere else."""

import numpy as np
import pytest
from arms import states
from pydrake.systems.framework import LeafSystem

from saphari_drake.perception.camera.frames import DepthFrames, instant, sample_at
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.robots.dynamics import evaluate_dynamics


def test_posture_is_interpolated_and_holds_at_both_ends():
    postures = ((0.0, np.array([0.0, 1.0])), (0.1, np.array([1.0, -1.0])), (0.2, np.array([3.0, -1.0])))
    np.testing.assert_allclose(sample_at(postures, 0.05), [0.5, 0.0])
    np.testing.assert_allclose(sample_at(postures, 0.15), [2.0, -1.0])
    np.testing.assert_array_equal(sample_at(postures, -1.0), [0.0, 1.0])
    np.testing.assert_array_equal(sample_at(postures, 1.0), [3.0, -1.0])


def test_an_instant_has_the_poses_of_the_dynamics(lwr4):
    for q, v in states(lwr4, 3):
        at = instant(lwr4, 0.0, q)
        terms = evaluate_dynamics(lwr4, q, v)
        np.testing.assert_allclose(at.R_WL, terms.R_WL, atol=1e-15)
        np.testing.assert_allclose(at.p_WL, terms.p_WL, atol=1e-15)


class Watcher(LeafSystem):
    """Has the ports of one camera."""

    def __init__(self, robot, params):
        super().__init__()
        self.ports = DepthFrames(self, robot, [params])


@pytest.mark.parametrize(
    ("stamp", "is_new"), [(0.9, True), (1.0, True), (1.001, False), (0.4, False), (0.5, False), (-0.1, False),
                          (np.nan, False), (np.inf, False)]
)  # fmt: skip
def test_a_frame_is_new_if_it_is_neither_known_nor_old_nor_of_the_future(lwr4, stamp, is_new):
    watcher = Watcher(lwr4, CameraParameters())
    context = watcher.CreateDefaultContext()
    context.SetTime(1.0)
    watcher.GetInputPort("image_time").FixValue(context, [stamp])
    assert watcher.ports.fresh(context, [0.5], 0.55) == ({0: stamp} if is_new else {})
