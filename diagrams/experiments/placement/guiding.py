"""Fits hand guiding to another arm: where the skin lies, and how the hands pull."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.placement.arm import PlacedArm, placed_arm
from saphari_drake.errors import ModelError
from saphari_drake.math.primitives import CAPSULE, CYLINDER
from saphari_drake.perception.skin.layout import MIN_CURVATURE_RADIUS, SkinLayoutParameters
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.guiding_hands import Hand

Array = NDArray[np.float64]


def skin_patch(arm: PlacedArm, layout: SkinLayoutParameters) -> None:
    """Put the patch on the side of the longest round shape between shoulder and forearm, as near the elbow as it fits.

    Raises
    ------
    ModelError
        If no shape there is long and thick enough.
    """
    shapes, chain = arm.robot.shapes, arm.chain
    need = 0.5 * layout.rows * layout.pitch
    best, length = None, 0.0
    for s in range(shapes.count):
        link, radius, half = int(shapes.link[s]), float(shapes.size[s, 0]), float(shapes.size[s, 1])
        round_ = shapes.kind[s] in (CAPSULE, CYLINDER) and shapes.size[s, 2] == 0.0
        fits = half >= need and radius >= MIN_CURVATURE_RADIUS and layout.columns * layout.pitch < 2.0 * np.pi * radius
        if round_ and fits and max(chain.upper_arm, 1) <= link <= chain.forearm and half > length:
            best, length = s, half
    if best is None:
        names = ", ".join(arm.robot.link_names[max(chain.upper_arm, 1) : chain.forearm + 1])
        raise ModelError(
            f"{arm.robot.name}: no round shape of {2.0 * need:g} m by {2.0 * MIN_CURVATURE_RADIUS:g} m "
            f"for the skin on {names}"
        )
    link = int(shapes.link[best])
    R_WS = arm.terms.R_WL[link] @ shapes.R_LS[best]
    axis = R_WS[:, 2]
    normal = arm.aside - (arm.aside @ axis) * axis
    if np.linalg.norm(normal) < 0.3:
        normal = arm.ahead - (arm.ahead @ axis) * axis
    normal_L = arm.terms.R_WL[link].T @ normal / np.linalg.norm(normal)
    layout.frame, layout.curvature_radius = arm.robot.link_names[link], float(shapes.size[best, 0])
    layout.normal, layout.axis = normal_L.tolist(), shapes.R_LS[best][:, 2].tolist()
    layout.centre = (shapes.p_LS[best] + layout.curvature_radius * normal_L).tolist()


def place_hands(scenario: Any, robot: RobotModel) -> None:
    """Fit a `GuidingScenario`: posture, skin, wrist sensor, and the pulls of the end effector along the arm's axes."""
    arm = placed_arm(robot)
    scenario.home = arm.home_deg
    system = scenario.system
    skin_patch(arm, system.skin_layout)
    system.pipeline.wrist.joint = system.force_sensor.joint = robot.joint_names[-1]
    system.pipeline.wrist.tip_frame = robot.link_names[-1]
    # Written for an arm that reaches along y: x there is to its right.
    R = np.column_stack([-arm.aside, arm.ahead, [0.0, 0.0, 1.0]])
    _turn(scenario.end_effector, R)


def _turn(hand: Hand, R: Array) -> None:
    for pull in hand.pulls:
        pull.size = (R @ np.asarray(pull.size)).tolist()
