"""CameraCheck: watches, while nobody is near, whether a camera is where it is taken to be."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.messages import Immutable
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.camera.check import CameraCheckParameters, CheckResult, CheckStatus, check_camera
from saphari_drake.perception.camera.frames import DepthFrames, Samples, sample_at
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_outputs

Array = NDArray[np.float64]
Depth = NDArray[np.float32]

_OLDEST = 0.2  # s, age of a frame that arrives
_REST = 0.1  # s, time for which the robot must be at rest before a frame


@dataclass
class CheckScheduleParameters:
    """When a camera is checked, and with what. All assumed."""

    # Time between two checks (s, > 0).
    interval: float = 2.0
    # Frames in different postures that a check takes at most (≥ 1), and the norm by which postures differ (rad, > 0).
    frames: int = 8
    apart: float = 0.3
    # Norm of the change of posture in 0.1 s up to which the robot counts as at rest (rad, > 0).
    rest: float = 0.005
    # Points of a person above which nothing is compared (≥ 0).
    person_points: int = 10

    def __post_init__(self) -> None:
        require_positive(self, "interval", "frames", "apart", "rest")
        require_non_negative(self, "person_points")


@dataclass(frozen=True)
class _Memory(Immutable):
    """All that changes. Never changed in place, so never copied."""

    postures: Samples = ()  # times (s) and joint positions (n,), oldest first
    stamp: float = -1.0  # s, of the last frame that was looked at
    kept: tuple[tuple[Array, Depth], ...] = ()  # postures and images of the next check, oldest first
    fresh: bool = False  # whether a frame was kept since the last check
    due: float = 0.0  # s, time of the next check
    status: CheckStatus = CheckStatus.UNKNOWN
    error: Array = field(default_factory=lambda: np.zeros(2))
    correction: RigidTransform = field(default_factory=RigidTransform)


class CameraCheck(LeafSystem):
    """Compares the robot's own depth with its model, and says how far the camera is off.

    .. pydrake_system::

        name: CameraCheck
        input_ports:
        - position_measured
        - depth_image
        - image_time
        - human_points
        output_ports:
        - check_status
        - extrinsic_error
        - correction

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    depth_image, image_time : abstract `ImageDepth32F` (m) and 1 (s), from a `DepthCameraSampler`.
    human_points : abstract (k, 3) array (m), from a localizer with the same camera; optional, default: nobody.
    check_status : 1, a `CheckStatus` as a number.
    extrinsic_error : 2, mean displacement of the robot's seen points (m) and turn (rad) by the last check; zero before.
    correction : abstract `RigidTransform`; the true pose of the camera is ``correction @ X_WC``. It deserves trust
        after frames in several postures: one posture shows that there is an error, not always which.

    Frames of the robot at rest with nobody in view are kept, one a posture. Every `interval` the camera is checked
    with them by `check_camera`, if there is a new one; frames of another size or with a posture that is not finite are
    left out. A camera so far off that the robot's own points look like a
    person's stays at BUSY.

    Parameters
    ----------
    robot : RobotModel
    camera : CameraParameters
        Of the camera, where it is taken to be unless `X_WC` is given.
    params : CameraCheckParameters, optional
    schedule : CheckScheduleParameters, optional
    X_WC : RigidTransform, optional
        Where the camera is taken to be.
    period : float
        Time between looks at the inputs (s).

    Raises
    ------
    ParameterError
        If the period is not positive.
    """

    def __init__(
        self,
        robot: RobotModel,
        camera: CameraParameters,
        params: CameraCheckParameters | None = None,
        schedule: CheckScheduleParameters | None = None,
        X_WC: RigidTransform | None = None,
        period: float = 0.005,
    ) -> None:
        super().__init__()
        if not 0.0 < period < np.inf:
            raise ParameterError("period", f"must be positive and finite, got {period}")
        self._robot, self._camera, self._X_WC = robot, camera, X_WC
        self._params, self._schedule = params or CameraCheckParameters(), schedule or CheckScheduleParameters()
        self._remembered = int(np.ceil((_OLDEST + _REST) / period)) + 1
        self._frames = DepthFrames(self, robot, [camera])
        self._person = self.DeclareAbstractInputPort("human_points", AbstractValue.Make(np.zeros((0, 3))))
        self._state = self.DeclareAbstractState(AbstractValue.Make(_Memory()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)
        reads = {
            "check_status": lambda memory: [float(memory.status)],
            "extrinsic_error": lambda memory: memory.error,
            "correction": lambda memory: memory.correction,
        }
        declare_outputs(self, self._memory, self.abstract_state_ticket(self._state), _Memory(), reads)
        check_camera(robot, camera, [robot.home], [np.zeros((camera.height, camera.width), np.float32)], self._params)

    def _memory(self, context: Context) -> _Memory:
        return context.get_abstract_state(int(self._state)).get_value()

    def _update(self, context: Context, state: State) -> EventStatus:
        memory, now = self._memory(context), context.get_time()
        memory = replace(memory, postures=self._frames.remember(context, memory.postures, self._remembered))
        fresh = self._frames.fresh(context, [memory.stamp], _OLDEST)
        if fresh:
            memory = self._with_frame(context, memory, fresh[0])
        if now >= memory.due and memory.fresh and memory.status != CheckStatus.BUSY:
            memory = self._checked(memory, now)
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _with_frame(self, context: Context, memory: _Memory, stamp: float) -> _Memory:
        """Keep a frame of the robot at rest; with a person in view say so."""
        memory = replace(memory, stamp=stamp)
        if self._person.HasValue(context) and len(self._person.Eval(context)) > self._schedule.person_points:
            return replace(memory, status=CheckStatus.BUSY)
        if memory.status == CheckStatus.BUSY:
            memory = replace(memory, status=CheckStatus.UNKNOWN, fresh=len(memory.kept) > 0)
        q, before = sample_at(memory.postures, stamp), sample_at(memory.postures, stamp - _REST)
        image = self._frames.depth(context)
        if image is None or not np.linalg.norm(q - before) <= self._schedule.rest:  # a posture that is not finite too
            return memory
        others = tuple(entry for entry in memory.kept if np.linalg.norm(entry[0] - q) >= self._schedule.apart)
        return replace(memory, kept=(*others, (q, image.copy()))[-int(self._schedule.frames) :], fresh=True)

    def _checked(self, memory: _Memory, now: float) -> _Memory:
        postures, images = [q for q, _ in memory.kept], [image for _, image in memory.kept]
        result: CheckResult = check_camera(self._robot, self._camera, postures, images, self._params, self._X_WC)
        memory = replace(memory, fresh=False, due=now + self._schedule.interval, status=result.status)
        if result.status == CheckStatus.UNKNOWN:
            return memory
        return replace(memory, error=np.array([result.displacement, result.turn]), correction=result.X_correct)
