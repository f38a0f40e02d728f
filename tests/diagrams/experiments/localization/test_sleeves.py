"""Sleeves: the depth of the arm is wrinkled, by as much as is asked, and nothing else is."""

import numpy as np
import pytest
from experiments.localization.sleeves import wrinkled
from pydrake.geometry import Capsule
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.perception.camera.model import CameraParameters, camera_pose, ray_tables

CAMERA = CameraParameters()
RADIUS, HALF, DEPTH = 0.05, 0.15, 1.5


@pytest.fixture(scope="module")
def arm():
    """A capsule across the view before a wall, its exact image, and which pixels show it."""
    X_CP = RigidTransform(RotationMatrix.MakeYRotation(np.pi / 2), [0.0, 0.0, DEPTH])
    image = np.full((480, 640), 2.5)
    x, y = (table.astype(float) for table in ray_tables(CAMERA))
    across = (np.abs(x)[None] * DEPTH < HALF) & (np.abs(y)[:, None] < 1.0)
    a, b = 1.0 + y[:, None] ** 2, DEPTH
    inside = b * b - a * (DEPTH**2 - RADIUS**2)
    hit = across & (inside > 0.0)
    z = (b - np.sqrt(np.maximum(inside, 0.0))) / a
    image[hit] = np.broadcast_to(z, image.shape)[hit]
    return [(Capsule(RADIUS, 2.0 * HALF), X_CP, "arm")], image.astype(np.float32), hit


def test_arm_alone_is_wrinkled_by_as_much_as_is_asked(arm):
    parts, image, hit = arm
    added = np.concatenate(
        [
            (wrinkled(image, CAMERA, camera_pose(CAMERA), parts, np.random.default_rng(seed), 0.004, 0.04) - image)[hit]
            for seed in range(20)
        ]
    )
    out = wrinkled(image, CAMERA, camera_pose(CAMERA), parts, np.random.default_rng(0), 0.004, 0.04)
    np.testing.assert_array_equal(out[~hit], image[~hit])
    assert np.std(added) == pytest.approx(0.004, rel=0.15)


def test_wrinkles_are_longer_than_a_pixel(arm):
    """Neighbours are lifted alike, unlike by a camera's noise."""
    parts, image, hit = arm
    added = wrinkled(image, CAMERA, camera_pose(CAMERA), parts, np.random.default_rng(0), 0.004, 0.04) - image
    both = hit[:, 1:] & hit[:, :-1]
    assert np.corrcoef(added[:, 1:][both], added[:, :-1][both])[0, 1] > 0.8


def test_arm_out_of_view_changes_nothing(arm):
    _, image, _ = arm
    away = [(Capsule(RADIUS, 2.0 * HALF), RigidTransform([50.0, 0.0, DEPTH]), "arm")]
    out = wrinkled(image, CAMERA, camera_pose(CAMERA), away, np.random.default_rng(0), 0.004, 0.04)
    np.testing.assert_array_equal(out, image)
