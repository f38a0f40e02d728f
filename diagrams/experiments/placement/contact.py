"""Fits the experiments of the contact cell to another arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.placement.arm import PlacedArm, placed_arm
from experiments.placement.pushes import AXES, MASS, effective_mass, push_on, require_pushes, side_camera
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.pushing_hand import Push

Array = NDArray[np.float64]
THREE = ([AXES[0], AXES[1]], [AXES[2], AXES[3]], [AXES[4], AXES[5]])  # ± x, ± y, ± z


def place_in_cell(scenario: Any, robot: RobotModel) -> PlacedArm:
    """Set the posture and the camera of a `ContactScenario`."""
    arm = placed_arm(robot)
    scenario.home = arm.home_deg
    side_camera(arm, scenario.system.camera)
    return arm


def touchable(arm: PlacedArm) -> list[int]:
    """Return the links from the forearm to the wrist that have a surface."""
    return arm.chain.links(arm.robot, max(arm.chain.forearm, 2))


def pushes_on_links(scenario: Any, arm: PlacedArm, like: Sequence[Push]) -> list[Push]:
    """Return pushes timed like those given, on different links from the forearm to the wrist where there are enough."""
    cell = scenario.system
    links = touchable(arm)
    found = [push_on(arm, cell.camera, cell.cell.hand, link) for link in links]
    pushes = require_pushes(arm, found, 1, "places to push")
    firm = [push for push in pushes if effective_mass(arm, push) >= MASS]
    pushes = firm or pushes
    chosen = [pushes[min(k, len(pushes) - 1)] for k in range(len(like))]
    return [_timed(push, given) for push, given in zip(chosen, like)]


def pushes_along(scenario: Any, arm: PlacedArm, like: Sequence[Push], wanted: int = 3) -> list[Push]:
    """Return pushes along so many of the axes x, y and z, timed like those given, all on the outermost such link.

    Raises
    ------
    ModelError
        If no link can be pushed along so many.
    """
    cell = scenario.system
    kept: list[Push] = []
    for link in touchable(arm)[::-1]:
        found = [push_on(arm, cell.camera, cell.cell.hand, link, axis) for axis in THREE]
        kept = max(kept, [push for push in found if push is not None], key=len)
        if len(kept) >= wanted:
            break
    pushes = require_pushes(arm, kept, wanted, "pushes along different axes of the world on one link")
    return [_timed(push, given) for push, given in zip(pushes, like)]


def _timed(push: Push, like: Push) -> Push:
    return replace(like, link=push.link, aim=push.aim, direction=push.direction, finger=push.finger)
