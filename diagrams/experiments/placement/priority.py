"""Fits the three levels of reverse priority to another arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.placement.arm import placed_arm
from saphari_drake.robots.model import RobotModel


def place_levels(scenario: Any, robot: RobotModel) -> None:
    """Fit a scenario of the case three_level: posture, guarded frames, path, person and the elbow's region."""
    arm = placed_arm(robot)
    names, chain, params, scale = robot.link_names, arm.chain, scenario.arm, min(arm.scale, 1.0)
    params.home, params.tip, params.elbow_frame = arm.home_deg, names[chain.tip], names[chain.elbow]
    params.guarded = list(names[chain.elbow :])
    params.circle *= scale
    y = float(arm.terms.p_WL[chain.elbow][1])
    params.elbow = [y + side for side in params.elbow]
    # The person stands where the tip is, as far as the LWR4's does.
    R = np.column_stack([arm.ahead, arm.aside, [0.0, 0.0, 1.0]])
    params.hand_centre, params.elbow_centre = (
        (R @ np.asarray(centre)).tolist() for centre in (params.hand_centre, params.elbow_centre)
    )
