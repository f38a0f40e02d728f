"""The background is learnt behind a robot that moves before it."""

import numpy as np
import pytest
from camera_scene import HandScene, likeliest, noisy, place_finder

from saphari_drake.errors import StateError
from saphari_drake.perception.segmentation.background import background_depth


@pytest.fixture(scope="module")
def scene():
    return HandScene(radius=0.010)


def test_background_is_removed_and_learnt_behind_the_robot(scene):
    rng = np.random.default_rng(4)
    wall = np.full((480, 640), 2.2, dtype=np.float32)
    wall[:, :100] = np.inf

    def with_wall(image, seed):
        return noisy(np.minimum(np.where(image > 0.0, image, np.inf), wall), seed)

    postures = [scene.robot.home + rng.uniform(-0.6, 0.6, scene.robot.n) * [3, 1, 1, 1, 1, 1, 1] for _ in range(12)]
    frames = [with_wall(scene.image(q), seed) for seed, q in enumerate(postures)]
    background = background_depth(frames)
    assert np.all(np.isinf(background[:, :98]))
    assert np.mean(np.abs(background[:, 130:] - 2.2) < 0.03) > 0.95  # the rest is the base, which never moves
    bare, learnt = place_finder(scene).camera, place_finder(scene, background)
    errors = []
    for seed in range(6):
        touch = scene.random_touch(rng)
        image = with_wall(scene.image(touch.q, touch), 50 + seed)
        errors.append(likeliest(learnt, image, touch)[1])
        person, everything = (camera.person(image, touch.R_WL, touch.p_WL) for camera in (learnt.camera, bare))
        assert len(person.points) < 0.2 * len(everything.points)
    assert np.median(errors) < 0.01


def test_background_ignores_single_far_readings_and_needs_half_of_the_readings():
    frames = np.full((10, 2, 3), 2.0, dtype=np.float32)
    frames[:4, 0, 0] = 1.0  # the robot was there
    frames[0, 0, 1] = 4.0  # one wrong reading
    frames[:5, 0, 2] = np.nan
    frames[:4, 1, 0] = 0.0
    background = background_depth(frames)
    np.testing.assert_allclose(background, [[2.0, 2.0, np.inf], [2.0, 2.0, 2.0]])
    with pytest.raises(StateError):
        background_depth(np.zeros((4, 5)))
