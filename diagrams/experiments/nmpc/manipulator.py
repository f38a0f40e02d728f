"""The manipulator's job of Section 3: to a reference pose, with obstacles where the straight way would collide."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from experiments.nmpc.build import NmpcCellParameters
from experiments.nmpc.jobs import ARM_POINTS, NmpcJob, Pose, fixed_obstacles, point_positions, pose_of
from experiments.nmpc.run import NmpcRun, counts, margins, timing
from saphari_drake.control.nmpc.parameters import NmpcParameters, TestPoint
from saphari_drake.errors import ParameterError
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.parameters import require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.runner.results import Metric

Array = NDArray[np.float64]

LEAN = 0.6  # rad
# Weights of the pose far above those of posture and obstacles, whose push would leave an error.
_POSE = [3000.0, 3000.0, 3000.0, 300.0, 300.0, 300.0]


def pose_controller() -> NmpcParameters:
    """Return weights for a pose that is reached and kept."""
    return NmpcParameters(
        Q_v=[0.05], Q_q=[1e-4], R_q=[1e-4], Q_e=_POSE, R_e=[5.0 * w for w in _POSE], velocity_scale=[0.5],
        clearance_margin=0.001, retreat=True, ramp=1.0, pull_linear=[0.02, 0.06],
        slack_penalty=1e5,
    )  # fmt: skip


@dataclass
class ManipulatorParameters:
    """The manipulator's job and its cell."""

    # deg; joint positions at the start. Empty: home, or a bent posture where that is near a joint limit.
    start_deg: list[float] = field(default_factory=list)
    # deg; posture whose end-effector pose is the reference. Empty: the start with its first joint turned by `turn_deg`.
    goal_deg: list[float] = field(default_factory=list)
    turn_deg: float = 60.0
    # Frame that follows the reference. Empty: the last link that a revolute joint moves.
    end_effector: str = ""
    # Whether the test points are those of Section 3, for the LWR4, or follow from the arm's chain.
    published_points: bool = True
    # m, world; obstacle points. Empty: two, beside where the arm would go (`obstacles_beside`).
    obstacles: list[list[float]] = field(default_factory=list)
    # m; distance that every test point keeps.
    d_min: float = 0.2
    # m²; weight of each test point in the objective (20). It trades the pose for distance.
    c: float = 3.0e-4
    cell: NmpcCellParameters = field(default_factory=lambda: NmpcCellParameters(controller=pose_controller()))

    def __post_init__(self) -> None:
        require_positive(self, "d_min", "c")
        sizes = {np.shape(point) for point in self.obstacles}
        if sizes - {(3,)} or not all(np.isfinite(point).all() for point in self.obstacles):
            raise ParameterError("obstacles", f"needs points of three finite coordinates, got {self.obstacles}")


def points_along(
    robot: RobotModel, end_effector: str, d_min: float, c: float, count: int = 8, published: bool = True
) -> tuple[TestPoint, ...]:
    """Return test points along a robot's chain.

    Those of Section 3 if published and the robot has their frames; otherwise the last `count` of: the places of the
    joints, the end effector, and the middle between two of them on links longer than 0.25 m.
    """
    names = {point.frame for point in ARM_POINTS}
    if published and names <= set(robot.link_names):
        return tuple(TestPoint(p.name, p.frame, p.p_FC, d_min, c) for p in ARM_POINTS)
    tree, points = robot.tree, []
    link, X_LF = robot.frame(end_effector)
    end = np.array(X_LF.translation())
    while link >= 0:
        length = float(np.linalg.norm(end))
        for share in (1.0, 0.5) if length > 0.25 else (1.0,):
            if length > 0.05:
                name = f"{robot.link_names[link]} {share:g}"
                points.append(TestPoint(name, robot.link_names[link], (share * end).tolist(), d_min, c))
        # The link's own joint, as a place on the parent.
        end, link = np.array(tree.p_PF[link]), int(tree.parent[link])
    return tuple(points[:count][::-1])


def obstacles_beside(
    robot: RobotModel, points: tuple[TestPoint, ...], start: Array, goal: Array, near: float = 0.08
) -> Array:
    """Return two points (2, 3): `near` (m) beside the arm's forearm at the goal, and 0.3 m above it halfway.

    The forearm is where the test point after the elbow is, and the elbow is the one farthest from the line between the
    first and the last. The obstacle is at the side to which it sticks out, so that the arm can get away by turning
    about that line.
    """
    at_goal = point_positions(robot, points, evaluate_dynamics(robot, goal, np.zeros(robot.n)))
    halfway = point_positions(robot, points, evaluate_dynamics(robot, 0.5 * (start + goal), np.zeros(robot.n)))
    line = (at_goal[-1] - at_goal[0]) / np.linalg.norm(at_goal[-1] - at_goal[0])
    aside = at_goal - at_goal[0]
    aside -= np.outer(aside @ line, line)
    middle = min(int(np.argmax(np.linalg.norm(aside, axis=1))) + 1, len(points) - 1)
    out = aside[middle] / np.linalg.norm(aside[middle])
    return np.array([at_goal[middle] + near * out, halfway[middle] + np.array([0.0, 0.0, 0.30])])


def manipulator_job(robot: RobotModel, params: ManipulatorParameters) -> NmpcJob:
    """Return the job; in the case none the obstacles exist as well, only that nothing is done about them."""
    start = _posture(robot, params.start_deg, _inside(robot, robot.home))
    turned = start.copy()
    turned[0] = np.clip(start[0] + np.deg2rad(params.turn_deg), robot.q_min[0], robot.q_max[0])
    goal = _posture(robot, params.goal_deg, turned)
    tip = params.end_effector or last_link(robot)
    points = points_along(robot, tip, params.d_min, params.c, published=params.published_points)
    pose = pose_of(robot, tip, goal)
    obstacles = np.array(params.obstacles, dtype=float).reshape(-1, 3)
    if len(obstacles) == 0:
        obstacles = obstacles_beside(robot, points, start, goal)

    def reference(time: float) -> Pose:
        return pose

    return NmpcJob(robot.with_home(start), tip, points, reference, fixed_obstacles(obstacles))


def _posture(robot: RobotModel, degrees: list[float], default: Array) -> Array:
    return robot.checked_vector(np.deg2rad(degrees), "posture") if len(degrees) else default


def _inside(robot: RobotModel, q: Array) -> Array:
    """Return `q`, or a bent posture in its place if a joint is nearer to a limit than a tenth of its range.

    As a file without a home has it: such joints go to the middle of their range, and the second one leans the arm over.
    """
    limited = np.isfinite(robot.q_min) & np.isfinite(robot.q_max)
    low, high = np.where(limited, robot.q_min, -1.0), np.where(limited, robot.q_max, 1.0)
    near = limited & (np.minimum(q - low, high - q) < 0.1 * (high - low))
    posture = np.where(near, 0.5 * (low + high), q)
    if near.any() and robot.n > 1:
        posture[1] = np.clip(posture[1] + LEAN, low[1], high[1])
    return posture


def last_link(robot: RobotModel) -> str:
    """Return the last link that a revolute joint moves, or the last of all."""
    revolute = np.flatnonzero(robot.tree.kind == REVOLUTE)
    return robot.link_names[int(revolute[-1])] if revolute.size else robot.link_names[-1]


def controller_for(case: str, params: NmpcParameters) -> NmpcParameters:
    """Set what makes a case: whether obstacles are in the objective, in the constraints, in both or in neither."""
    params.obstacle_cost = case in ("objective", "both")
    params.obstacle_constraints = case in ("constraints", "both")
    return params


def judge_manipulator(run: NmpcRun, params: ManipulatorParameters, case: str) -> list[Metric]:
    """Return the metrics; the pose is that of the last half second, the distance that of every step of 1 ms."""
    log = run.log
    last = log.time >= log.time[-1] - 0.5
    position, turn = log["position_error"][last, 0].max(), log["orientation_error"][last, 0].max()
    bounds = {"none": (1e-4, np.inf, -np.inf), "both": (1e-3, 0.005, params.d_min)}
    at_most, turned, away = bounds.get(case, (np.inf, np.inf, -np.inf))
    if case == "constraints":
        away = params.d_min
    return [
        Metric("position_error_m", position, "m", high=at_most, reported="reaches the pose (Fig. 1)"),
        Metric("orientation_error_rad", turn, "rad", high=turned),
        Metric("min_distance_m", log["distance"].min(), "m", low=away, reported="0.2 m (Fig. 1)"),
        *counts(run),
        *timing(run, ""),
        *margins(run),
    ]
