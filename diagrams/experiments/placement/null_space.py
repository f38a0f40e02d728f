"""Fits the experiments of null-space compliance to another arm: what touches it, where, and the gains."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.placement.arm import PlacedArm, null_space_gains, placed_arm, task_gain_ratio
from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.math.primitives import CAPSULE, CYLINDER
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.obstacles import TouchPlace, approach

Array = NDArray[np.float64]
MOBILITY = 0.1  # share of the reach; least motion of the touched point for a unit motion that keeps the tip


class ElbowTouch(NamedTuple):
    """A place near the elbow, and the direction in which it moves most while the tip stays."""

    link: int
    aim: Array  # (3,) m, link frame
    direction: Array  # (3,) world
    mobility: float  # m/rad


def self_motion(arm: PlacedArm) -> Array:
    """Return the joint velocities (n, n − 3) that keep the tip's position, orthonormal."""
    J = arm.terms.point(arm.chain.tip, np.zeros(3)).Jv_WC
    return np.asarray(np.linalg.svd(J)[2][3:].T)


def elbow_touch(arm: PlacedArm) -> ElbowTouch:
    """Return where to touch the arm: on the link below the elbow, or beyond it, that yields most.

    Raises
    ------
    ModelError
        If nothing there can yield while the tip stays.
    """
    robot, chain, N = arm.robot, arm.chain, self_motion(arm)
    candidates = []
    for link in (chain.upper_arm, chain.forearm):
        for aim in _axis_points(robot, link, arm.terms.in_link(link, arm.terms.p_WL[chain.elbow])):
            J = arm.terms.point(link, aim).Jv_WC @ N
            U, sigma, _ = np.linalg.svd(J)
            horizontal = U[:, 0] * [1.0, 1.0, 0.0]  # a ball from above or below would meet the weight
            size = float(np.linalg.norm(horizontal))
            if size > 0.5:
                candidates.append(ElbowTouch(link, aim, horizontal / size, float(sigma[0])))
    best = max(candidates, key=lambda touch: touch.mobility, default=None)
    if best is None or best.mobility < MOBILITY * chain.reach:
        found = "none" if best is None else f"{best.mobility:.2f} m/rad"
        raise ModelError(
            f"{robot.name}: {robot.n} joints leave the elbow {found} of sideways motion while the tip stays, "
            f"{MOBILITY * chain.reach:.2f} m/rad needed: no null space to be compliant in"
        )
    return best


def place_obstacles(scenario: Any, robot: RobotModel) -> None:
    """Fit a `NullSpaceScenario`: posture, ball and wall at the elbow, gains, and the motion sideways."""
    arm = placed_arm(robot)
    touch = elbow_touch(arm)
    scenario.home = arm.home_deg
    controller, cell = scenario.system.controller, scenario.system.cell
    controller.null_stiffness, controller.null_damping = null_space_gains(arm)
    ratio = task_gain_ratio(arm)
    controller.K_p, controller.K_v = ratio * controller.K_p, np.sqrt(ratio).item() * controller.K_v
    # Ball and wall come from the side to which the tip moves, so that the elbow runs into the wall.
    side = -touch.direction if touch.direction @ arm.aside > 0.0 else touch.direction
    place = _open_side(arm, touch, side, cell.ball.radius)
    cell.ball.touch, cell.wall.touch = place, TouchPlace(place.link, list(place.aim), list(place.direction))
    scale = min(arm.scale, 1.0)
    scenario.motion.displacement = (-scale * np.linalg.norm(scenario.motion.displacement) * side).tolist()
    cell.wall.gap *= scale


def _open_side(arm: PlacedArm, touch: ElbowTouch, side: Array, radius: float) -> TouchPlace:
    """The place with a direction along which a ball meets the link."""
    for direction in (side, -side):
        place = TouchPlace(arm.robot.link_names[touch.link], touch.aim.tolist(), direction.tolist())
        try:
            approach(arm.robot, place, radius)
        except ParameterError:
            continue
        return place
    raise ModelError(f"{arm.robot.name}: no ball meets {arm.robot.link_names[touch.link]} from the side")


def _axis_points(robot: RobotModel, link: int, p_L: Array) -> list[Array]:
    """Points of the axes of a link's shapes that are nearest to a point of the link, one a shape."""
    shapes, points = robot.shapes, []
    for s in np.flatnonzero(shapes.link == link):
        half = shapes.size[s, 1] if shapes.kind[s] in (CAPSULE, CYLINDER) else 0.0
        axis = shapes.R_LS[s][:, 2]
        points.append(shapes.p_LS[s] + np.clip((p_L - shapes.p_LS[s]) @ axis, -half, half) * axis)
    return points
