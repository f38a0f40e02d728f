"""The cameras of random scenes, checked and corrected by the robot that they see before anybody touches it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from experiments.localization.scenario import ContactLocalizationScenario
from experiments.localization.scenes import ContactScenes
from saphari_drake.perception.camera.check import check_camera
from saphari_drake.perception.camera.model import CameraParameters, camera_pose

Array = NDArray[np.float64]

_POSTURES = 16  # of the robot alone, of which each scene draws its own


class Alone(NamedTuple):
    """The robot alone: postures (k, n) and the exact image of each camera in each."""

    postures: list[Array]
    images: list[list[NDArray[np.float32]]]


def robot_alone(scenario: ContactLocalizationScenario, scenes: ContactScenes) -> Alone:
    """Return the robot alone in random postures; none if no camera is checked."""
    rng = np.random.default_rng([scenario.seed, 3])
    postures = [scenes.posture(rng) for _ in range(_POSTURES if scenario.checked else 0)]
    return Alone(postures, [scenes.images([], q) for q in postures])


def corrections(
    scenario: ContactLocalizationScenario,
    scenes: ContactScenes,
    alone: Alone,
    believed: list[CameraParameters],
    rng: np.random.Generator,
) -> list[RigidTransform]:
    """Return the correction of each camera, by noisy images of some of the postures."""
    count = int(min(scenario.checked, len(alone.postures)))
    if count == 0:
        return [RigidTransform()] * len(believed)
    own = rng.spawn(1)[0]
    chosen = own.choice(len(alone.postures), count, replace=False)
    return [
        check_camera(
            scenes.robot,
            camera,
            [alone.postures[i] for i in chosen],
            [scenes.noisy(alone.images[i][k], k, own) for i in chosen],
            scenario.check,
        ).X_correct
        for k, camera in enumerate(believed)
    ]


def displaced(true: CameraParameters, believed: CameraParameters, X_correct: RigidTransform, p_W: Array) -> float:
    """Return how far (m) from itself a camera that is taken to be elsewhere shows a point p_W (3,) of the world."""
    X_WC = X_correct @ camera_pose(believed)
    return float(np.linalg.norm(X_WC @ (camera_pose(true).inverse() @ p_W) - p_W))
