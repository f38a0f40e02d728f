"""Frames of a sound camera are trusted, with a person in view too; a blind, noisy or moved one is told."""

import numpy as np
import pytest
from bench import Bench
from experiments.localization.parameters import SceneParameters
from experiments.localization.scenes import ContactScenes
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import ParameterError
from saphari_drake.messages import CameraStatus
from saphari_drake.perception.camera.frame_check import FrameStatus, surface_points
from saphari_drake.perception.camera.frame_check_system import FrameCheck
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.segmentation.background import background_depth
from saphari_drake.simulation.faults.frames import blind, noisier

SHIFT = 0.03  # m


@pytest.fixture(scope="module")
def scene(lwr4):
    """Background, frames in three postures, and those of cameras that were moved."""
    camera, rng = CameraParameters(), np.random.default_rng(1)
    postures = [lwr4.home + 0.5 * rng.uniform(-1.0, 1.0, 7) for _ in range(3)]
    scenes = ContactScenes(lwr4, [camera], SceneParameters(hands=1))
    background = background_depth([scenes.noisy(scenes.images([], q)[0], 0, rng) for q in postures for _ in range(2)])
    frames = [(q, scenes.noisy(scenes.images([], q)[0], 0, rng)) for q in postures]
    moved = []
    for direction in np.vstack((np.eye(3), -np.eye(3))):
        aside = SHIFT * direction
        other = CameraParameters(
            position=(np.array(camera.position) + aside).tolist(), target=(np.array(camera.target) + aside).tolist()
        )
        there = ContactScenes(lwr4, [other], SceneParameters(hands=1))
        moved.append((postures[0], there.noisy(there.images([], postures[0])[0], 0, rng)))
    return background, frames, moved


@pytest.fixture(scope="module")
def check(lwr4, scene):
    return FrameCheck(lwr4, CameraParameters(), background=scene[0])


def status(check, frame):
    return check.figures(frame[1], frame[0]).status(check._params)


def test_points_lie_on_the_robot(lwr4):
    points, shapes = surface_points(lwr4, 100), lwr4.shapes
    for link, p_L, n_L in zip(*points):
        surface, normal = shapes.nearest_on(link, p_L + 1e-3 * n_L)
        np.testing.assert_allclose(surface, p_L, atol=1e-9)
        np.testing.assert_allclose(normal, n_L, atol=1e-6)


def test_a_sound_camera_is_trusted(check, scene):
    assert {status(check, frame) for frame in scene[1]} == {FrameStatus.OK}


def test_somebody_before_the_camera_is_no_fault(check, scene):
    """A third of the image at half a metre: in front of robot and floor."""
    q, image = scene[1][0]
    image = image.copy()
    image[:, 200:420] = 0.5
    assert status(check, (q, image)) == FrameStatus.OK


def test_a_camera_that_was_moved_is_told(check, scene):
    """By 3 cm, in each direction of the world."""
    assert [status(check, frame) for frame in scene[2]] == [FrameStatus.MOVED] * 6


def test_a_patch_without_readings_and_thrice_the_noise_are_told(check, scene):
    q, image = scene[1][0]
    assert status(check, (q, blind(0.34)(image.copy(), image, 0))) == FrameStatus.BLIND
    assert status(check, (q, noisier(0.004, 1.7, 3)(image.copy(), image, 0))) == FrameStatus.NOISY


def picture(depth):
    value = ImageDepth32F(640, 480)
    value.mutable_data[..., 0] = depth
    return value


def test_two_bad_frames_end_the_trust_and_five_good_ones_bring_it_back(lwr4, check, scene):
    (q, good), (_, bad) = scene[1][0], scene[2][0]
    bench = Bench(check, position_measured=q, depth_image=picture(good), image_time=-1.0, camera_status=CameraStatus.OK)
    told = []
    for image in [good, bad, good, bad, bad, *[good] * 5]:
        bench.run(2, depth_image=picture(image), image_time=bench.cycles * 0.005)
        told.append(bench.read("camera_status") == CameraStatus.OK)
    assert told == [True] * 4 + [False] * 5 + [True]
    bench.run(1, camera_status=CameraStatus.STALE)
    assert bench.read("camera_status") == CameraStatus.STALE


def test_what_is_not_known_is_not_looked_at(check, scene):
    image = scene[1][0][1]
    assert np.isnan(check.figures(image, np.full(7, np.nan)).robot)
    nothing = check.figures(np.zeros_like(image), scene[1][0][0])
    assert np.isnan(nothing.noise) and nothing.status(check._params) == FrameStatus.BLIND


def test_a_background_of_another_size_is_refused(lwr4):
    with pytest.raises(ParameterError, match="background"):
        FrameCheck(lwr4, CameraParameters(), background=np.zeros((2, 2), np.float32))
