"""The omniRob's job of Section 3: a path through six obstacles, or past a person, also without slipping sideways."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from experiments.nmpc.build import NmpcCellParameters
from experiments.nmpc.jobs import OBSTACLES, OMNIROB_POINTS, NmpcJob, Pose, fixed_obstacles, pose_of
from saphari_drake.control.nmpc.parameters import NmpcParameters
from saphari_drake.errors import ParameterError
from saphari_drake.math.curves import quintic
from saphari_drake.messages import ObstaclePoints
from saphari_drake.parameters import require_non_negative, require_positive, require_vector
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters
from saphari_drake.simulation.people.motion import HumanMotionParameters, HumanPath

Array = NDArray[np.float64]
SEEN = ("human_seen", "human_random")  # cases in which a camera tells where a person is
BASE = ("px", "py", "pz")
TIP = "link_7"


@dataclass
class MobilePathParameters:
    """The end effector's path: along y at constant speed and height."""

    # m/s, and y at which it ends (m). The published problem.
    speed: float = 0.2
    end: float = 6.0
    # m; height of the path. The published problem.
    height: float = 1.2
    # m; how far the path of the case nonholonomic moves sideways, and between which y it does. Assumed.
    shift: float = 0.4
    shift_from: float = 1.0
    shift_to: float = 4.0

    def __post_init__(self) -> None:
        require_positive(self, "speed", "height")
        if not self.shift_from < self.shift_to:
            raise ParameterError("shift_to", f"must exceed shift_from, got {self.shift_to}")


def person_beside_the_path() -> HumanMotionParameters:
    """Return a person who stands at the right of the path and reaches across it."""
    return HumanMotionParameters(position=[-0.35, 3.0, 1.3])


def problem_controller() -> NmpcParameters:
    """Return the weights of the published problem."""
    return NmpcParameters(
        Q_v=[0.2, 0.2, 0.2, *[0.05] * 7],
        Q_q=[0.02],
        R_q=[0.1],
        velocity_scale=[1.0, 1.0, 1.0, *[0.5] * 7],
        clearance_margin=0.005,
        acceleration_max=[1.0, 1.0, 1.0, *[5.0] * 7],
        ramp=1.0,
    )


def problem_cell() -> NmpcCellParameters:
    """Return a cell whose platform is asked for 1 m/s² and 1 rad/s² at most, and its arm for 8 rad/s²."""
    envelope = VelocityEnvelopeParameters(acceleration_max=[1.0, 1.0, 1.0, *[8.0] * 7])
    return NmpcCellParameters(controller=problem_controller(), envelope=envelope)


@dataclass
class MobileParameters:
    """The mobile manipulator's job, its cell and the person."""

    path: MobilePathParameters = field(default_factory=MobilePathParameters)
    cell: NmpcCellParameters = field(default_factory=lambda: problem_cell())
    # Of the cases human, human_seen and human_random.
    person: HumanMotionParameters = field(default_factory=person_beside_the_path)
    # m, 1 and s; of human_random: half ranges of place and size, and the range of when the motion begins. Assumed.
    place_range: list[float] = field(default_factory=lambda: [0.15, 0.3, 0.1])
    size_range: float = 0.1
    start_range: float = 20.0
    # s; from noticing something to standing, for `stoppable_clearance`: two control periods and braking. Assumed.
    reaction: float = 0.3

    def __post_init__(self) -> None:
        require_positive(self, "reaction")
        require_vector(self, 3, "place_range")
        require_non_negative(self, "place_range", "size_range", "start_range")
        if self.size_range >= 1.0:
            raise ParameterError("size_range", f"must be less than 1, got {self.size_range}")


def random_person(params: MobileParameters, seed: int | None) -> HumanMotionParameters:
    """Return the person of a seed: elsewhere, larger or smaller, and at another time of the motion."""
    rng, person = np.random.default_rng([seed or 0, 16]), params.person
    place = np.array(person.position) + np.array(params.place_range) * rng.uniform(-1.0, 1.0, 3)
    size = person.scale * (1.0 + params.size_range * rng.uniform(-1.0, 1.0))
    start = person.start + float(rng.uniform(0.0, params.start_range))
    return replace(person, position=place.tolist(), scale=float(size), start=start)


def mobile_start(robot: RobotModel) -> Array:
    """Return joint positions with the platform heading along y, at x = 0, and the end effector at y = 0."""
    q = robot.home.copy()
    q[:3] = 0.0, 0.0, 0.5 * np.pi
    q[1] = -pose_of(robot, TIP, q)[1][1]
    return q


def mobile_job(robot: RobotModel, params: MobileParameters, case: str) -> NmpcJob:
    """Return the job of a case."""
    start = mobile_start(robot)
    R_start, _ = pose_of(robot, TIP, start)
    path = params.path
    turning = case == "nonholonomic"

    def reference(time: float) -> Pose:
        y = min(path.speed * time, path.end)
        if not turning:
            return R_start, np.array([0.0, y, path.height])
        x, slope = _shifted(path, y)
        angle = np.arctan2(slope, 1.0)  # to the right of y
        c, s = np.cos(-angle), np.sin(-angle)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_start, np.array([x, y, path.height])

    obstacles: Callable[[float], ObstaclePoints]
    if case in ("human", *SEEN):
        obstacles = HumanPath(params.person)
    elif case == "nonholonomic":
        obstacles = fixed_obstacles(OBSTACLES[:2] + np.array([[-0.6, 0.0, 0.0], [0.6, 0.0, 0.0]]))
    else:
        obstacles = fixed_obstacles(OBSTACLES)
    return NmpcJob(robot.with_home(start), TIP, OMNIROB_POINTS, reference, obstacles)


def _shifted(path: MobilePathParameters, y: float) -> tuple[float, float]:
    """Return x and dx/dy of the path that moves sideways."""
    length = path.shift_to - path.shift_from
    share, slope, _ = quintic((y - path.shift_from) / length)
    return path.shift * share, path.shift * slope / length


def controller_for(case: str, params: NmpcParameters) -> NmpcParameters:
    """Set what makes a case: obstacles in the objective, in the constraints, and whether the platform can slip."""
    params.obstacle_cost = case != "1"
    params.obstacle_constraints = case not in ("1", "2")
    params.nonholonomic = list(BASE) if case == "nonholonomic" else []
    if case in ("human", *SEEN):
        # A hand that starts to reach. Assumed.
        params.obstacle_acceleration = 4.0
        params.retreat, params.delay_compensation = True, case == "human_random"
    return params
