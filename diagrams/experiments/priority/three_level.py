"""Three levels on an arm: limits and moving obstacles on top, a path in the middle, a soft region of the elbow."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.control.joint_servo import JointServoParameters
from saphari_drake.control.reverse_priority.stack import PriorityStack
from saphari_drake.control.reverse_priority.system import ReversePriorityParameters
from saphari_drake.control.reverse_priority.tasks import (
    Bound,
    Level,
    joint_limits,
    plane_distance,
    position_task,
    target_distance,
)
from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters
from saphari_drake.simulation.faults.people import course
from saphari_drake.simulation.world.profile import Truth

Array = NDArray[np.float64]


@dataclass
class ThreeLevelParameters:
    """Job and surroundings; assumed."""

    # deg; posture at the start. Empty: the model's own home posture.
    home: list[float] = field(default_factory=list)
    # End effector that follows the path, and frame whose origin is the elbow.
    tip: str = "link_7"
    elbow_frame: str = "link_4"
    # Frames whose origins keep clear of the person.
    guarded: list[str] = field(default_factory=lambda: ["link_4", "link_5", "link_6", "link_7"])
    # m; radius of the arm at those points plus that of the person's hand or elbow.
    radius: float = 0.13
    # m; least clearance, and the buffer above it in which the arm begins to give way.
    clearance: float = 0.02
    buffer: float = 0.10
    # m; the bound given to the controller lies farther out than the clearance, for the lag of the servo.
    margin: float = 0.005
    # rad; margin and buffer of the joint limits.
    limit_margin: float = 0.01
    limit_buffer: float = 0.2
    # m; circle of the end effector in the plane of y and z, about its home position, and s, one turn of it.
    circle: float = 0.10
    turn: float = 6.0
    # m; the elbow's soft region in y, and its buffer.
    elbow: list[float] = field(default_factory=lambda: [-0.02, 0.02])
    elbow_buffer: float = 0.015
    # m/s; speed limit of the person, and m, how far the person's hand and elbow roam about their centres.
    person_speed: float = 0.25
    reach: list[float] = field(default_factory=lambda: [0.10, 0.40, 0.25])
    # m; centres, relative to the end effector's home position.
    hand_centre: list[float] = field(default_factory=lambda: [0.05, 0.10, 0.10])
    elbow_centre: list[float] = field(default_factory=lambda: [0.25, 0.25, 0.10])
    # 1/s, on the position error of the end effector.
    gain: float = 5.0
    controller: ReversePriorityParameters = field(
        default_factory=lambda: ReversePriorityParameters(period=0.001, acceleration_max=[10.0])
    )
    envelope: VelocityEnvelopeParameters = field(default_factory=VelocityEnvelopeParameters)
    servo: JointServoParameters = field(default_factory=lambda: JointServoParameters(integral_gain=2500.0))

    def __post_init__(self) -> None:
        require_positive(self, "radius", "buffer", "limit_buffer", "elbow_buffer", "turn", "person_speed")
        require_non_negative(self, "clearance", "margin", "limit_margin", "circle", "gain", "reach")
        for name in ("elbow", "reach", "hand_centre", "elbow_centre"):
            if len(getattr(self, name)) != (2 if name == "elbow" else 3):
                raise ParameterError(name, f"needs {2 if name == 'elbow' else 3} numbers, got {getattr(self, name)}")


class Person:
    """Hand and elbow of a scripted person: sums of three sines in each direction, never faster than a limit.

    Calling it gives the positions and velocities of both in the world (m, m/s).
    """

    def __init__(self, p_home: Array, params: ThreeLevelParameters, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._centres = p_home + np.array([params.hand_centre, params.elbow_centre])
        self._omega = 2.0 * np.pi * rng.uniform(0.05, 0.25, (2, 3, 3))
        self._phase = rng.uniform(0.0, 2.0 * np.pi, (2, 3, 3))
        share = rng.uniform(0.3, 1.0, (2, 3, 3))
        self._amplitude = share / share.sum(axis=2, keepdims=True) * np.array(params.reach)[:, None]
        fastest = np.linalg.norm(np.sum(self._amplitude * self._omega, axis=2), axis=1)
        self._omega *= np.minimum(1.0, params.person_speed / fastest)[:, None, None]

    def __call__(self, time: ArrayLike) -> Array:
        """Return positions and velocities (…, 2, 6) at a time or an array of times (…)."""
        angle = self._omega * np.asarray(time, dtype=float)[..., None, None, None] + self._phase
        position = self._centres + np.sum(self._amplitude * np.sin(angle), axis=-1)
        velocity = np.sum(self._amplitude * self._omega * np.cos(angle), axis=-1)
        return np.concatenate([position, velocity], axis=-1)


class ThreeLevelJob(NamedTuple):
    """What both the full and the kinematic simulation run."""

    robot: RobotModel
    params: ThreeLevelParameters
    levels: list[Level]
    person: Callable[[ArrayLike], Array]
    p_home: Array


def three_level_job(robot: RobotModel, params: ThreeLevelParameters, seed: int) -> ThreeLevelJob:
    """Return the stack and the person of a seed; the person starts clear of the arm."""
    link, X_LF = robot.frame(params.tip)
    p_home = robot.kinematics(robot.home).position(link, X_LF.translation())
    distances = [
        Bound(
            target_distance(robot, frame, target, params.radius),
            lower=params.clearance + params.margin,
            buffer=params.buffer,
        )
        for frame in params.guarded
        for target in range(2)
    ]
    low, high = params.elbow
    elbow = Bound(plane_distance(robot, params.elbow_frame, [0.0, 1.0, 0.0]), low, high, params.elbow_buffer)
    levels: list[Level] = [
        [*joint_limits(robot, params.limit_margin, params.limit_buffer), *distances],
        position_task(robot, params.tip, gain=params.gain),
        [elbow],
    ]
    for attempt in range(100):
        person = Person(p_home, params, seed + 1000 * attempt)
        if clearances(robot, params, robot.home, person(0.0)).min() > params.clearance + params.margin:
            return ThreeLevelJob(robot, params, levels, person, p_home)
    raise ParameterError("reach", "the person stands in the arm at the start, for every seed tried")


def with_faults(job: ThreeLevelJob, truth: Truth) -> ThreeLevelJob:
    """Return the job with a person who is faster than assumed, or comes in from outside, as `truth` has it."""
    if not {"person_faster", "person_unseen"} & set(truth.faults):
        return job

    def at(time: ArrayLike) -> Array:
        rows = []
        for moment in np.ravel(time):
            now = course(truth, float(moment), (0.0, 1.0, 0.0))
            meant = job.person(now.time)
            rows.append(np.concatenate([meant[:, :3] + now.offset, now.pace * meant[:, 3:] + now.velocity], axis=1))
        return np.reshape(rows, (*np.shape(time), 2, 6))

    return job._replace(person=at)


def circle_reference(job: ThreeLevelJob, time: ArrayLike) -> Array:
    """Return the reference (…, 18) of the end effector: a circle through its home position, begun smoothly."""
    t = np.asarray(time, dtype=float)
    rate, radius = 2.0 * np.pi / job.params.turn, job.params.circle
    begun = np.minimum(t / 2.0, 1.0)
    angle = rate * np.where(t < 2.0, 2.0 * (begun**3 - 0.5 * begun**4), t - 1.0)
    speed = rate * radius * begun**2 * (3.0 - 2.0 * begun)
    zero = np.zeros_like(t)
    p = job.p_home + radius * np.stack([zero, np.sin(angle), 1.0 - np.cos(angle)], axis=-1)
    v = speed[..., None] * np.stack([zero, np.cos(angle), np.sin(angle)], axis=-1)
    R = np.broadcast_to(np.eye(3).ravel(), (*t.shape, 9))
    return np.concatenate([R, p, np.zeros((*t.shape, 3)), v], axis=-1)


def clearances(robot: RobotModel, params: ThreeLevelParameters, q: Array, targets: Array) -> Array:
    """Return the clearance (m) of every guarded point from every part of the person."""
    points = []
    for frame in params.guarded:
        link, X_LF = robot.frame(frame)
        points.append(robot.kinematics(q).position(link, X_LF.translation()))
    gaps = np.linalg.norm(np.array(points)[:, None] - targets[None, :, :3], axis=2)
    return np.asarray(gaps.ravel() - params.radius)


class KinematicRun(NamedTuple):
    """A run of an arm that follows its commands exactly, at every cycle."""

    q: Array  # (T, n)
    v: Array  # (T, n)
    clearance: Array  # (T,) least of all pairs, m
    status: Array  # (T,)
    error: Array  # (T,) of the end effector, m
    elbow: Array  # (T,) y of the elbow, m


def run_kinematic(job: ThreeLevelJob, duration: float) -> KinematicRun:
    """Run a job without dynamics."""
    robot, params = job.robot, job.params
    controller, period = params.controller, params.controller.period
    stack = PriorityStack(robot, job.levels, controller.damping, controller.task_damping)
    steps = round(duration / period)
    q, v = robot.home.copy(), np.zeros(robot.n)
    rows = []
    times = period * np.arange(steps)
    references, targets = circle_reference(job, times)[:, None], job.person(times)
    first = 2 * sum(1 for b, s in stack.sides if s > 0 and b.component.unit == "rad")
    distances = slice(first, first + 2 * len(params.guarded))
    for k in range(steps):
        result = stack.solve(q, controller.decay * v, references[k], targets[k], period)
        v = result.v
        gap = -result.x[distances].max()
        rows.append((q, v, gap, result.status, float(np.linalg.norm(result.error)), result.x[-2]))
        q = q + period * v
    return KinematicRun(*(np.array(column) for column in zip(*rows)))
