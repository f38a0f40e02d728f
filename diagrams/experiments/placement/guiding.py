"""Fits hand guiding to another arm: where the skin lies, and how the hands pull."""

from __future__ import annotations

import itertools
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.guiding.judge import near_limits
from experiments.guiding.run import hands_of
from experiments.placement.arm import PlacedArm, placed_arm
from saphari_drake.control.hand_guiding.law import HandGuiding
from saphari_drake.control.hand_guiding.touch import HandForces
from saphari_drake.errors import ModelError
from saphari_drake.math.primitives import CAPSULE, CYLINDER
from saphari_drake.perception.skin.layout import MIN_CURVATURE_RADIUS, SkinLayout, SkinLayoutParameters
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.guiding_hands import Hand

Array = NDArray[np.float64]
SIZES = (1.0, 0.7, 0.5)  # of the pulls; the first with which joints keep clear of their limits
PERIOD = 0.01  # s, of the cycles in which that is tried


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
    """Fit a `GuidingScenario`: posture, skin, wrist sensor, and the pulls of the end effector along the arm's axes.

    They are turned to the sides, and lowered, as it takes for the joints to keep clear of their limits; what comes
    nearest to that if nothing does.
    """
    arm = placed_arm(robot)
    scenario.home = arm.home_deg
    system = scenario.system
    skin_patch(arm, system.skin_layout)
    system.pipeline.wrist.joint = system.force_sensor.joint = robot.joint_names[-1]
    system.pipeline.wrist.tip_frame = robot.link_names[-1]
    # Written for an arm that reaches along y: x there is to its right.
    R = np.column_stack([-arm.aside, arm.ahead, [0.0, 0.0, 1.0]])
    given, hand = deepcopy(scenario.end_effector.pulls), scenario.end_effector
    if scenario.case == "recorded":
        _turn(hand, R)
        return
    least, best = np.inf, hand.pulls
    for size, *signs in itertools.product(SIZES, (1.0, -1.0), (1.0, -1.0), (1.0, -1.0)):
        hand.pulls = deepcopy(given)
        _turn(hand, size * R * signs)
        cycles = sum(held_back(scenario, arm.robot, second) for second in (0.0, 1.0, 3.0))
        if cycles < least:
            least, best = cycles, hand.pulls
        if least == 0:
            break
    hand.pulls = best


def held_back(scenario: Any, robot: RobotModel, second: float) -> int:
    """Return in how many cycles joints would come near their limits, with the second hand's force so many times."""
    tried, system = deepcopy(scenario), deepcopy(scenario.system)
    tried.second_scale *= second
    system.pipeline.__post_init__()
    # Gains of the servo are without effect on what is commanded; these suit the period.
    other = {"feedback": "commanded", "K_P": 400.0, "K_D": 40.0, "hand_stiffness": 0.0, "period": PERIOD}
    params = replace(system.pipeline.controller, **other)
    hands = hands_of(tried, system, robot, SkinLayout(robot, system.skin_layout), Path())
    law, path = HandGuiding(robot, params), []
    state = law.start(evaluate_dynamics(robot, robot.home, np.zeros(robot.n)))
    for time in np.arange(0.0, tried.duration, PERIOD):
        force = np.array([grip.hand.demand(time) for grip in hands])
        link = hands[1].link if force[1].any() else -1
        terms = evaluate_dynamics(robot, state.q, state.v)
        state, _ = law.step(state, terms, HandForces(force, np.zeros(robot.n), link, hands[1].p_LC, True))
        path.append((state.q, state.v))
    q, v = np.array(path).transpose(1, 0, 2)
    return int(near_limits(robot, params, q, v).sum())


def _turn(hand: Hand, R: Array) -> None:
    for pull in hand.pulls:
        pull.size = (R @ np.asarray(pull.size)).tolist()
