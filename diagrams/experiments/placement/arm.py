"""An arm at the posture in which an experiment starts, and the scale of everything around it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.robots.chain import ArmChain, arm_chain
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.robots.posture import bent_home, is_home

Array = NDArray[np.float64]
LWR4_REACH = 0.79  # m; the experiments were laid out for an arm of this reach
NULL_SPACE_RATE, NULL_SPACE_DAMPING, NULL_SPACE_LOAD = 3.0, 1.2, 0.5


class PlacedArm(NamedTuple):
    """An arm at its start.

    Attributes
    ----------
    robot : RobotModel
        With the start as its home posture.
    chain : ArmChain
    terms : DynamicsTerms
        At the start.
    home_deg : list of float
        The start in degrees, as a scenario takes it.
    """

    robot: RobotModel
    chain: ArmChain
    terms: DynamicsTerms
    home_deg: list[float]

    @property
    def scale(self) -> float:
        """Its reach as a multiple of the LWR4's."""
        return self.chain.reach / LWR4_REACH

    @property
    def ahead(self) -> Array:
        """Horizontal unit direction (3,) from the base to the tip."""
        way = self.tip - self.terms.p_WL[0]
        return np.array([way[0], way[1], 0.0]) / max(float(np.hypot(way[0], way[1])), 1e-9)

    @property
    def aside(self) -> Array:
        """Horizontal unit direction (3,) to the left of `ahead`."""
        x, y, _ = self.ahead
        return np.array([-y, x, 0.0])

    @property
    def tip(self) -> Array:
        """Origin (3,) of the last link, m."""
        return np.asarray(self.terms.p_WL[self.chain.tip])

    @property
    def middle(self) -> Array:
        """Point (3,) in the middle of shoulder, elbow and wrist, m."""
        chain = self.chain
        return np.asarray(self.terms.p_WL[[chain.shoulder, chain.elbow, chain.wrist]].mean(axis=0))


def placed_arm(robot: RobotModel) -> PlacedArm:
    """Return an arm at its own home, or at one that is found for it.

    Raises
    ------
    ModelError
        If it is no fixed-base arm with shapes and limits.
    """
    home = robot.home if is_home(robot) else bent_home(robot)
    degrees = np.round(np.rad2deg(home), 2)
    robot = robot.with_home(np.deg2rad(degrees))
    terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
    return PlacedArm(robot, arm_chain(robot), terms, degrees.tolist())


def place_arm(scenario: Any, robot: RobotModel) -> None:
    """Set the posture of a scenario that has nothing else to be fitted to an arm."""
    scenario.home = placed_arm(robot).home_deg


def null_space_gains(arm: PlacedArm) -> tuple[list[float], list[float]]:
    """Return stiffness (Nm/rad) and damping (Nms/rad) of the joints: K_i = ω² M_ii and D_i = 2 ζ ω M_ii at the start.

    ω and ζ are about those of the LWR4's own gains. A stiffness that half a radian would load with more than half of
    the torque limit is cut, and the damping with it.
    """
    inertia = np.diag(arm.terms.M)
    stiffness = np.minimum(NULL_SPACE_RATE**2 * inertia, NULL_SPACE_LOAD * arm.robot.tau_max / 0.5)
    damping = 2.0 * NULL_SPACE_DAMPING * np.sqrt(stiffness * inertia)
    return stiffness.tolist(), damping.tolist()
