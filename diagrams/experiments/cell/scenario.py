"""What the safe cell's trials depend on: robot, job, cameras and people."""

from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from experiments.nmpc.jobs import pose_of
from saphari_drake.errors import ParameterError
from saphari_drake.math.curves import quintic
from saphari_drake.parameters import require_choice, require_positive
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.skin.layout import SkinLayoutParameters
from saphari_drake.pipelines.safe_cell.job_path import Job
from saphari_drake.pipelines.safe_cell.parameters import SafeCellParameters
from saphari_drake.robots import catalog
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.nearness import surface_of
from saphari_drake.simulation.people.compliant_people import PeopleParameters
from saphari_drake.simulation.people.guiding_hands import Hand
from saphari_drake.simulation.people.performance import PerformanceParameters, performance
from saphari_drake.simulation.people.skeleton import segment_ends
from saphari_drake.simulation.people.touching import Touches, touches
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.sensors.depth_noise import SamplerParameters
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensorParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters
from saphari_drake.simulation.sensors.skin_sensor import SkinSensorParameters
from saphari_drake.simulation.world.plant import PlantParameters

Array = NDArray[np.float64]
# The ways to be beside people that are compared: all methods under the supervisor; a robot that keeps its distance and
# stops when it cannot; one that also stops at every contact; one that is always as slow as a contact may be hard.
WAYS = ("supervised", "separation", "stop_at_contact", "force_limited")

# m, from the robot, where recorded people begin at least, and how many places are tried.
BEGIN_APART, TRIES = 0.1, 200
# m; where the path of the platform's arm is, from where that of the fixed one is.
FARTHER = (0.25, 0.0, 0.1)


def _camera(position: list[float]) -> CameraParameters:
    return CameraParameters(
        width=320, height=240, focal_x=287.5, focal_y=287.5, position=position, target=[0.5, 0.0, 1.0]
    )


def _cameras() -> list[CameraParameters]:
    return [_camera([-1.3, 1.3, 2.3]), _camera([-0.6, -1.9, 2.2])]


@dataclass
class CellScenario(PlantScenario):
    """Everything a run depends on."""

    case: str = "fixed"
    # s; longest time for a job.
    duration: float = 14.0
    # Trials, each with its own person; folder of BVH files they are drawn from; empty: made-up people.
    trials: int = 1
    recordings: str = ""
    # Which ways are run, each in every trial; `WAYS` lists all.
    ways: list[str] = field(default_factory=lambda: list(WAYS[:3]))
    # m; height of the robot's base above the floor, and s; its job at full speed.
    base_height: float = 0.6
    job_time: float = 8.0
    # The person without recordings; a hand at the tool, which leads the robot.
    person: PerformanceParameters = field(
        default_factory=lambda: PerformanceParameters(
            way=[[0.0, 2.4, -0.2], [2.0, 1.05, -0.1], [9.0, 1.05, -0.1], [11.0, 2.6, -0.2], [20.0, 2.6, -0.2]],
            reach_from=2.5, reach_until=5.5, reach_to=[0.5, 0.05, 1.2],
        )
    )  # fmt: skip
    people: PeopleParameters = field(default_factory=PeopleParameters)
    hand: Hand = field(default_factory=Hand)
    cameras: list[CameraParameters] = field(default_factory=_cameras)
    sampler: SamplerParameters = field(default_factory=SamplerParameters)
    plant_parameters: PlantParameters = field(default_factory=PlantParameters)
    joint_sensor: JointSensorParameters = field(default_factory=lambda: JointSensorParameters(position_resolution=1e-6))
    skin_layout: SkinLayoutParameters = field(default_factory=SkinLayoutParameters)
    skin_sensor: SkinSensorParameters = field(default_factory=SkinSensorParameters)
    force_sensor: ForceTorqueSensorParameters = field(default_factory=ForceTorqueSensorParameters)
    pipeline: SafeCellParameters = field(default_factory=SafeCellParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "trials", "job_time")
        for way in self.ways:
            if way not in WAYS:
                require_choice(_Way(way), "way", WAYS)
        for part in (self.joint_sensor, self.skin_sensor, self.force_sensor):
            part.period = self.pipeline.period


@dataclass
class _Way:
    way: str


def robot_of(scenario: CellScenario) -> RobotModel:
    """Return the robot of a scenario, a fixed one on its base."""
    if scenario.case == "fixed":
        return scenario.known(catalog.load(scenario.robot, RigidTransform([0.0, 0.0, scenario.base_height])))
    return scenario.known(catalog.load(scenario.robot))


def job_of(robot: RobotModel, scenario: CellScenario) -> Job:
    """Return a job from one place to another and back, along a curve that the robot can follow."""
    ends = [robot.home.copy(), robot.home.copy()]
    if scenario.case == "fixed":
        ends[0][0], ends[1][0] = np.deg2rad(-40.0), np.deg2rad(40.0)
    else:
        ends[0][1], ends[1][1] = -0.6, 0.6
    half, frame = 0.5 * scenario.job_time, robot.link_names[-1]

    def pose(time: float) -> tuple[Array, Array]:
        share = quintic(time / half)[0] if time <= half else quintic(2.0 - time / half)[0]
        return pose_of(robot, frame, ends[0] + share * (ends[1] - ends[0]))

    return Job(frame, pose, scenario.job_time)


def at_start(robot: RobotModel, scenario: CellScenario) -> RobotModel:
    """Return the robot with the posture at the begin of its job as home."""
    q = robot.home.copy()
    if scenario.case == "fixed":
        q[0] = np.deg2rad(-40.0)
    else:
        q[1] = -0.6
    return robot.with_home(q)


def seeded(scenario: CellScenario, trial: int) -> CellScenario:
    """Return a copy in which the noise of all sensors is that of the trial."""
    own = deepcopy(scenario)
    camera, skin, modules, force = np.random.SeedSequence([scenario.seed, trial]).generate_state(4).tolist()
    own.sampler.noise.seed, own.skin_sensor.seed = camera, skin
    own.skin_sensor.modules.seed, own.force_sensor.seed = modules, force
    return own


def person_of(scenario: CellScenario, trial: int) -> PerformanceParameters:
    """Return the person of a trial: a recording, placed in the cell at random, or the made-up one, moved at random."""
    rng, person = np.random.default_rng([scenario.seed, 5, trial]), deepcopy(scenario.person)
    if not scenario.recordings:
        if trial:
            person.reach_from += rng.uniform(-1.0, 2.0)
            person.reach_until = person.reach_from + rng.uniform(1.0, 4.0)
            person.reach_speed = rng.uniform(0.3, 1.6)
            person.reach_to = (np.array(person.reach_to) + rng.uniform(-0.15, 0.15, 3)).tolist()
        return person
    files = sorted(Path(scenario.recordings).rglob("*.bvh"))
    if not files:
        raise ParameterError("recordings", f"no .bvh file in '{scenario.recordings}'")
    person.file = str(files[trial % len(files)])
    person.spot = _spot(scenario, rng)
    person.yaw, person.start = rng.uniform(150.0, 210.0), rng.uniform(0.0, 5.0)
    return _clear_of_robot(scenario, person, rng)


def _spot(scenario: CellScenario, rng: np.random.Generator) -> list[float]:
    farther = FARTHER[0] if scenario.case == "mobile" else 0.0
    return [rng.uniform(0.75, 1.15) + farther, rng.uniform(-0.3, 0.3)]


def _clear_of_robot(
    scenario: CellScenario, person: PerformanceParameters, rng: np.random.Generator
) -> PerformanceParameters:
    """Return the first, of a person and others who begin elsewhere and at another time, who does not begin in it."""
    robot = at_start(robot_of(scenario), scenario)
    surface, motion = surface_of(robot), robot.kinematics(robot.home).motion
    recorded, flesh = performance(replace(person, spot=[0.0, 0.0]), scenario.people.sizes), scenario.people.flesh(1)
    for _ in range(TRIES):
        begin = recorded._replace(start=person.start).at(0.0) + np.array([*person.spot, 0.0])
        ends = segment_ends(begin, scenario.people.sizes)
        if Touches(*touches(surface, motion, ends, 0.0 * ends, flesh)).gap.min() > BEGIN_APART:
            return person
        person = replace(person, spot=_spot(scenario, rng), start=rng.uniform(0.0, 5.0))
    raise ParameterError("recordings", f"the person of '{person.file}' nowhere begins {BEGIN_APART} m away")


def for_way(scenario: CellScenario, way: str) -> SafeCellParameters:
    """Return the pipeline's parameters of one way to be beside people."""
    params = deepcopy(scenario.pipeline)
    if way in ("separation", "stop_at_contact"):
        params.signals.limit = "separation"
        params.verified_stop.touch = False
    if way == "force_limited":
        params.signals.limit = "force"
        params.force_limit.reach = 10.0
    if way != "supervised":
        params.supervisor.answer = "stop"
    if way == "stop_at_contact":
        params.supervisor.release_time = 5.0  # s, until somebody has started it again; assumed
    return params
