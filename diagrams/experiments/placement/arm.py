"""An arm at the posture in which an experiment starts, and the scale of everything around it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.robots.chain import ArmChain, arm_chain
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.robots.posture import FLOOR, bent_home, is_home

Array = NDArray[np.float64]
LWR4_REACH = 0.79  # m; the experiments were laid out for an arm of this reach
LWR4_TIP_MASS, MOST_GAIN = 2.34, 5.0  # kg, least effective mass of its tip; – , so that a cycle of 2 ms still suffices
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


def placed_arm(robot: RobotModel, floor: float = FLOOR) -> PlacedArm:
    """Return an arm at its own home, or at one that is found for it, from the elbow on not lower than `floor` (m).

    Raises
    ------
    ModelError
        If it is no fixed-base arm with shapes and limits.
    """
    home = robot.home if is_home(robot) else bent_home(robot, floor)
    degrees = np.round(np.rad2deg(home), 2)
    robot = robot.with_home(np.deg2rad(degrees))
    terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
    return PlacedArm(robot, arm_chain(robot), terms, degrees.tolist())


def keep(scenario: Any, robot: RobotModel) -> None:
    """Leave a scenario as it is but for the posture, which is the robot's own: all else follows from the robot."""
    if hasattr(scenario, "home"):
        scenario.home = []


def task_gain_ratio(arm: PlacedArm) -> float:
    """Return how much larger the gains over inertia have to be, ≥ 1, for the tip to resist a force as the LWR4's does.

    A law ẍ = −K_p e answers an unexplained force F with e = Λ⁻¹ F / K_p: an arm with a lighter tip needs more.
    """
    J = arm.terms.point(arm.chain.tip, np.zeros(3)).Jv_WC
    lightest = 1.0 / float(np.linalg.eigvalsh(J @ np.linalg.solve(arm.terms.M, J.T))[-1])
    return min(max(LWR4_TIP_MASS / lightest, 1.0), MOST_GAIN)


def null_space_gains(arm: PlacedArm) -> tuple[list[float], list[float]]:
    """Return stiffness (Nm/rad) and damping (Nms/rad) of the joints: K_i = ω² M_ii and D_i = 2 ζ ω M_ii at the start.

    ω and ζ are about those of the LWR4's own gains. A stiffness that half a radian would load with more than half of
    the torque limit is cut, and the damping with it.
    """
    inertia = np.diag(arm.terms.M)
    stiffness = np.minimum(NULL_SPACE_RATE**2 * inertia, NULL_SPACE_LOAD * arm.robot.tau_max / 0.5)
    damping = 2.0 * NULL_SPACE_DAMPING * np.sqrt(stiffness * inertia)
    return stiffness.tolist(), damping.tolist()
