"""Fits the identification to another arm: a posture with room to move about, and how far it moves."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from experiments.placement.arm import placed_arm
from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.estimation.excitation import draw_excitation
from saphari_drake.robots.chain import arm_chain
from saphari_drake.robots.model import RobotModel

HEIGHTS = (0.65, 0.5, 0.35, 0.2)  # shares of the reach, of the lowest place from the elbow on, the best first
REACHES = (1.0, 0.7, 0.5, 0.35)  # of the largest deflections that the scenario asks for, the best first


def place_excitation(scenario: Any, robot: RobotModel) -> None:
    """Set the posture of an `IdentifyScenario`, as high as one is found, and lower its deflections if they need it.

    Raises
    ------
    ModelError
        If no motion keeps above the floor.
    """
    reach = arm_chain(robot).reach
    wanted = scenario.excitation.reach
    for share in REACHES:
        for height in HEIGHTS:
            with contextlib.suppress(ModelError, ParameterError):
                arm = placed_arm(robot, height * reach)
                scenario.home, scenario.excitation.reach = arm.home_deg, share * wanted
                draw_excitation(arm.robot, scenario.excitation, np.random.default_rng(0))
                return
    raise ModelError(f"{robot.name}: no motion of all joints keeps {scenario.excitation.height} m above the floor")
