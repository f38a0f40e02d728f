"""The scan of an empty cell: the floor, with the robot before it in many postures, and the camera's noise."""

import numpy as np

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.simulation.sensors.background_scan import scan_background
from saphari_drake.simulation.sensors.depth_noise import DepthNoiseParameters
from saphari_drake.simulation.world.floor import Floor

CAMERA = CameraParameters(width=80, height=60, focal_x=72.0, focal_y=72.0, renderer="raycast")


def test_frames_differ_by_noise_alone_and_are_the_same_for_a_seed():
    """Without a robot the exact images are equal; noise is another in each frame, and the same again for its seed."""
    exact = scan_background(None, Floor(16.0), CAMERA, DepthNoiseParameters(enabled=False), 3)
    assert exact.shape == (3, 60, 80)
    np.testing.assert_array_equal(exact[0], exact[2])
    seeds = [scan_background(None, Floor(16.0), CAMERA, DepthNoiseParameters(seed=seed), 2) for seed in (3, 3, 4)]
    np.testing.assert_array_equal(seeds[0], seeds[1])
    assert not np.array_equal(seeds[0][0], seeds[0][1]) and not np.array_equal(seeds[0], seeds[2])


def test_the_robot_stands_before_the_floor_and_moves_from_frame_to_frame(lwr4):
    """It is nearer than the floor where it is; most of where it was in one it leaves in another."""
    noise = DepthNoiseParameters(enabled=False)
    floor = scan_background(None, Floor(), CAMERA, noise, 1)[0]
    frames = scan_background(lwr4, Floor(), CAMERA, noise)
    before = frames < floor - 0.01
    assert np.all(frames <= floor + 1e-6)
    assert before[0].sum() > 20
    assert np.mean(np.any(~before[1:], axis=0)[before[0]]) > 0.3  # its base stays
