"""Fits the scenes of the contact localization to another arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.placement.arm import placed_arm
from experiments.placement.pushes import side_camera
from saphari_drake.robots.model import RobotModel


def place_scenes(scenario: Any, robot: RobotModel) -> None:
    """Set posture and cameras of a `ContactLocalizationScenario`: the second one looks from ahead, the other side."""
    arm = placed_arm(robot)
    scenario.home = arm.home_deg
    side_camera(arm, scenario.cameras[0])
    for camera in scenario.cameras[1:]:
        away = 1.2 * arm.ahead - 1.4 * arm.aside + np.array([0.0, 0.0, 0.65])
        camera.target = np.round(arm.middle, 3).tolist()
        camera.position = np.round(arm.middle + max(arm.scale, 0.6) * away, 3).tolist()
