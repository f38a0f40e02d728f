"""CameraCheck: watches, by the robot that it sees, whether a camera is where it is taken to be, and corrects that."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.messages import Immutable
from saphari_drake.parameters import require_positive
from saphari_drake.perception.camera.check import check_camera, check_result
from saphari_drake.perception.camera.check_parameters import CameraCheckParameters, CheckStatus
from saphari_drake.perception.camera.frames import DepthFrames, Samples, sample_at
from saphari_drake.perception.camera.model import CameraParameters, camera_pose
from saphari_drake.perception.camera.registration import (
    Cloud,
    Registration,
    Sums,
    correction,
    mean_displacement,
    next_round,
    registered,
    robot_cloud,
    with_cloud,
)
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_outputs

Array = NDArray[np.float64]

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
    # Largest change of the correction by a check, as the mean displacement of the robot's seen points (m, > 0).
    step: float = 0.003

    def __post_init__(self) -> None:
        require_positive(self, "interval", "frames", "apart", "rest", "step")


@dataclass(frozen=True)
class _Memory(Immutable):
    """All that changes. Never changed in place, so never copied."""

    postures: Samples = ()  # times (s) and joint positions (n,), oldest first
    stamp: float = -1.0  # s, of the last frame that was looked at
    kept: tuple[tuple[Array, Cloud], ...] = ()  # postures and what was seen there, oldest first
    fresh: bool = False  # whether a frame was kept since the last check began
    due: float = 0.0  # s, time of the next check
    checked: tuple[Cloud, ...] = ()  # what the present check compares; none: there is no check
    search: Registration = field(default_factory=Registration)
    sums: Sums = field(default_factory=Sums)
    status: CheckStatus = CheckStatus.UNKNOWN
    error: Array = field(default_factory=lambda: np.zeros(2))
    x: Array = field(default_factory=lambda: np.zeros(6))  # turn (rad) and shift (m) that are published
    correction: RigidTransform = field(default_factory=RigidTransform)
    covariance: Array = field(default_factory=lambda: np.zeros(36))


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
        - correction_covariance

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    depth_image, image_time : abstract `ImageDepth32F` (m) and 1 (s), from a `DepthCameraSampler`.
    human_points : abstract (k, 3) array (m), from a localizer with the same camera; optional, default: nobody.
    check_status : 1, a `CheckStatus` as a number.
    extrinsic_error : 2, mean displacement of the robot's seen points (m) and turn (rad) by the last check; zero before.
    correction : abstract `RigidTransform`; the true pose of the camera is ``correction @ X_WC``. Identity before the
        first check, and where the camera is displaced by more than may be corrected.
    correction_covariance : 36, row by row, of the turn (rad) and shift (m) of the camera about its centre that the
        correction leaves. What the postures so far do not show keeps the variance of the prior, and is not corrected.

    What is seen of the robot at rest, away from the person, is kept, one frame a posture. Every `interval` a check
    begins if there is a new one: the registration of `check_camera` over all postures that are kept, with one posture
    in each cycle, until it settles. What it finds is approached by `step` a check. Frames of another size or with a
    posture that is not finite are left out; so are those in which the person hides nearly all of the robot. A camera so
    far off that the robot's own points look like a person's stays at BUSY.

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
        self._robot, self._camera = robot, camera
        self._X_WC = camera_pose(camera) if X_WC is None else X_WC
        self._params, self._schedule = params or CameraCheckParameters(), schedule or CheckScheduleParameters()
        self._remembered = int(np.ceil((_OLDEST + _REST) / period)) + 1
        self._frames = DepthFrames(self, robot, [camera])
        self._person = self.DeclareAbstractInputPort("human_points", AbstractValue.Make(np.zeros((0, 3))))
        p = self._params
        self._state = self.DeclareAbstractState(AbstractValue.Make(_Memory(covariance=p.prior().ravel())))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)
        reads = {
            "check_status": lambda memory: [float(memory.status)],
            "extrinsic_error": lambda memory: memory.error,
            "correction": lambda memory: memory.correction,
            "correction_covariance": lambda memory: memory.covariance,
        }
        declare_outputs(self, self._memory, self.abstract_state_ticket(self._state), _Memory(), reads)
        p_WC = (
            self._X_WC.inverse().rotation().matrix() @ (robot.kinematics(robot.home).p_WL - self._X_WC.translation()).T
        )
        check_camera(robot, camera, [robot.home], [self._wall(float(np.median(p_WC[2])))], p, self._X_WC)  # compiles

    def _wall(self, z: float) -> NDArray[np.float32]:
        """Return the image of a wall at depth z (m)."""
        return np.full((self._camera.height, self._camera.width), z, np.float32)

    def _memory(self, context: Context) -> _Memory:
        return context.get_abstract_state(int(self._state)).get_value()

    def _update(self, context: Context, state: State) -> EventStatus:
        memory, now = self._memory(context), context.get_time()
        memory = replace(memory, postures=self._frames.remember(context, memory.postures, self._remembered))
        fresh = self._frames.fresh(context, [memory.stamp], _OLDEST)
        if fresh:
            memory = self._with_frame(context, memory, fresh[0])
        if memory.checked:
            memory = self._with_posture(memory)
        elif now >= memory.due and memory.fresh:
            clouds = tuple(cloud for _, cloud in memory.kept)
            due = now + self._schedule.interval
            memory = replace(memory, fresh=False, due=due, checked=clouds, search=Registration(), sums=Sums())
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _with_frame(self, context: Context, memory: _Memory, stamp: float) -> _Memory:
        """Keep what a frame shows of the robot at rest; if a person hides it, say so."""
        memory = replace(memory, stamp=stamp)
        if memory.fresh and memory.due > context.get_time():
            return memory  # the next check has its new posture
        q, before = sample_at(memory.postures, stamp), sample_at(memory.postures, stamp - _REST)
        image = self._frames.depth(context)
        if image is None or not np.linalg.norm(q - before) <= self._schedule.rest:  # a posture that is not finite too
            return memory
        person = np.asarray(self._person.Eval(context)) if self._person.HasValue(context) else np.zeros((0, 3))
        cloud = robot_cloud(self._robot, self._camera, q, image, self._params, self._X_WC, person)
        if len(person) > 0 and len(cloud.p_C) < self._params.least_points:
            return replace(memory, status=CheckStatus.BUSY)
        others = tuple(entry for entry in memory.kept if np.linalg.norm(entry[0] - q) >= self._schedule.apart)
        return replace(memory, kept=(*others, (q, cloud))[-int(self._schedule.frames) :], fresh=True)

    def _with_posture(self, memory: _Memory) -> _Memory:
        """Go on with a check by one posture, and publish what it found."""
        cloud, params = memory.checked[memory.sums.clouds], self._params
        sums = with_cloud(memory.sums, self._robot, cloud, memory.search, params, self._X_WC)
        if sums.clouds < len(memory.checked):
            return replace(memory, sums=sums)
        search = next_round(memory.search, sums, params)
        if not registered(search, params):
            return replace(memory, search=search, sums=Sums())
        result = check_result(memory.checked, search, params, self._X_WC)
        memory, x = replace(memory, checked=(), status=result.status), search.x
        if result.status == CheckStatus.UNKNOWN:
            return memory
        if result.status == CheckStatus.BEYOND:
            x = np.zeros(6)
        far = mean_displacement(memory.x, x, cloud, self._X_WC)
        x = memory.x + min(1.0, self._schedule.step / max(far, 1e-9)) * (x - memory.x)
        return replace(
            memory,
            error=np.array([result.displacement, result.turn]),
            x=x,
            correction=correction(x, self._X_WC),
            covariance=result.covariance.ravel(),
        )
