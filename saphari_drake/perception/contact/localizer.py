"""ContactLocalizer: from cameras' frames, measured posture and residual to where a person touches the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.messages import CameraStatus, Immutable
from saphari_drake.perception.camera.frames import DepthFrames, Instant, Samples, instant, sample_at
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.camera_memory import NOBODY, CameraMemory
from saphari_drake.perception.contact.finding import ContactFinder, Found
from saphari_drake.perception.contact.noise import QuietNoise
from saphari_drake.perception.contact.parameters import FusionParameters, LocalizerParameters
from saphari_drake.perception.contact.places import PlaceFinder, View
from saphari_drake.perception.segmentation.robot_filter import Depth, RobotFilter
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_outputs

Array = NDArray[np.float64]

_WORST_LAST = (CameraStatus.OK, CameraStatus.WAITING, CameraStatus.INVALID, CameraStatus.STALE)
_STANDS = Value[RigidTransform](RigidTransform())


@dataclass(frozen=True)
class _Memory(Immutable):
    """All that changes. Never changed in place, so never copied."""

    postures: Samples = ()
    residuals: Samples = ()  # empty if no residual is connected
    cameras: tuple[CameraMemory, ...] = ()
    stamp: float = -np.inf  # s, of the newest frame
    known: Found = ContactFinder.nothing
    quiet: QuietNoise | None = None

    @property
    def status(self) -> CameraStatus:
        """The worst of the cameras."""
        return max((camera.status for camera in self.cameras), key=_WORST_LAST.index, default=CameraStatus.WAITING)


class ContactLocalizer(LeafSystem):
    """Finds where a person touches the robot, by one depth camera or more and the residual.

    .. pydrake_system::

        name: ContactLocalizer
        input_ports:
        - position_measured
        - depth_image
        - image_time
        - torque_external
        - torque_noise
        - contact
        - correction
        output_ports:
        - contact_point
        - camera_status
        - human_points
        - second_contact_point
        - contact_force
        - second_contact_force
        - other_mode
        - other_mode_weight
        - contact_modes

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    depth_image : abstract `ImageDepth32F` (m), from a `DepthCameraSampler`; one a camera, see `DepthFrames`.
    image_time : 1 (s), the time at which that image was taken; a change says that a frame has arrived.
    torque_external : n (Nm), optional, from `MomentumObserver`; positive along the torque that the person causes. One
        that is not finite counts as none.
    torque_noise : n (Nm), optional, measured standard deviation of torque_external; counts where it is finite and above
        that of the parameters.
    contact : 1, optional, from `ContactDetector`: while nobody touches, the deviation of a frame's residual, which is
        the mean over `averaged`, is measured, and counts instead.
    correction : abstract `RigidTransform`, optional, from `CameraCheck`: the camera's pose is ``correction @ X_WC``.
        One a camera: with several, ``correction_0``, ``correction_1`` and so on.
    contact_point : abstract `ContactPoint`; its distance is zero where no camera sees the person there.
    camera_status : 1, the worst `CameraStatus` of all cameras, as a number.
    human_points : abstract (k, 3) array, points of the person in the world (m) in the last frames.
    second_contact_point : abstract `ContactPoint`, found only while two contacts are felt and seen.
    contact_force, second_contact_force : 3 (N, world), of the person on the robot, inside the friction cone.
    other_mode : abstract `ContactPoint`, the best explanation at another place.
    other_mode_weight : 1, its probability against that of the contact (0–0.5): near 0.5 the contact is ambiguous.
    contact_modes : abstract `ContactModes`, every place that has a probability of `least_mode` (5 %), with it.

    Every `period` posture and residual are remembered; when frames have arrived, those of the newest frame's own time
    stamp pose the robot. It and the static background are removed from the images, and the rest is explained as
    something thin or as a limb that touches (`PlaceFinder`). The camera that sees the person nearest counts, smoothed
    over frames, and the residual may correct and veto (`ContactTracker`). A touch that is felt but not seen is where
    cameras and residual together explain it best, with the force (`ContactFusionLaw`); both by `ContactFinder`.

    A camera that is not OK is left out: its frames are late or of another size, hold almost no reading, or belong to a
    posture that is not finite. With none that is OK, no contact is found.

    Parameters
    ----------
    robot : RobotModel
    cameras : sequence of CameraParameters
        Of the cameras that took the images.
    params : LocalizerParameters, optional
    backgrounds : sequence of (height, width) float32 arrays, optional
        Static background of each camera, see `background_depth`; default: none in view.
    poses : sequence of RigidTransform, optional
        Pose X_WC of each camera where it is known better than from its parameters, see `check_camera`.
    fusion : FusionParameters, optional
        Of hidden contacts and of forces.
    period : float
        Time between looks at the inputs (s).

    Raises
    ------
    ParameterError
        If there is no camera, a background or pose is missing or of another size, or the period is not positive.
    """

    def __init__(
        self,
        robot: RobotModel,
        cameras: Sequence[CameraParameters],
        params: LocalizerParameters | None = None,
        backgrounds: Sequence[Depth | None] | None = None,
        poses: Sequence[RigidTransform | None] | None = None,
        fusion: FusionParameters | None = None,
        period: float = 0.005,
    ) -> None:
        super().__init__()
        if not 0.0 < period < np.inf:
            raise ParameterError("period", f"must be positive and finite, got {period}")
        if len(cameras) == 0:
            raise ParameterError("cameras", "at least one is needed")
        backgrounds, poses = backgrounds or [None] * len(cameras), poses or [None] * len(cameras)
        for name, entries in (("backgrounds", backgrounds), ("poses", poses)):
            if len(entries) != len(cameras):
                raise ParameterError(name, f"needs one a camera ({len(cameras)}), got {len(entries)}")
        self._robot, self._params = robot, params or LocalizerParameters()
        self._finders = [
            PlaceFinder(RobotFilter(robot.shapes, *entry[:1], self._params, *entry[1:]), self._params)
            for entry in zip(cameras, backgrounds, poses)
        ]
        self._way = ContactFinder(robot, self._params, fusion or FusionParameters())
        self._least_noise = self._way.torque_sigma
        self._kept = int(np.ceil(self._params.memory / period)) + 1
        self._frames = DepthFrames(self, robot, cameras)
        self._residual = self.DeclareVectorInputPort("torque_external", BasicVector(robot.n))
        self._noise = self.DeclareVectorInputPort("torque_noise", BasicVector(robot.n))
        self._contact = self.DeclareVectorInputPort("contact", BasicVector(1))
        self._corrections = [
            self.DeclareAbstractInputPort(f"correction_{k}" if len(cameras) > 1 else "correction", _STANDS)
            for k in range(len(cameras))
        ]
        nothing = _Memory()
        self._state = self.DeclareAbstractState(AbstractValue.Make(nothing))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)
        self._declare_outputs(nothing)

    def _declare_outputs(self, nothing: _Memory) -> None:
        reads = self._way.outputs.items()
        found = {name: lambda m, read=read: read(m.known, m.stamp) for name, read in reads}
        ports = {
            "contact_point": found.pop("contact_point"),
            "camera_status": lambda m: [float(m.status)],
            "human_points": lambda m: np.concatenate([NOBODY, *(camera.points for camera in m.cameras)]),
            **found,
        }
        declare_outputs(self, self._memory, self.abstract_state_ticket(self._state), nothing, ports)

    def _memory(self, context: Context) -> _Memory:
        return context.get_abstract_state(int(self._state)).get_value()

    def _update(self, context: Context, state: State) -> EventStatus:
        memory, now = self._memory(context), context.get_time()
        memory = replace(
            memory,
            postures=self._frames.remember(context, memory.postures, self._kept),
            residuals=self._with_residual(context, memory.residuals),
            cameras=memory.cameras or (CameraMemory(now),) * len(self._finders),
        )
        memory = self._with_frames(context, memory)
        if all(camera.status != CameraStatus.OK for camera in memory.cameras):
            memory = replace(memory, known=self._way.nothing)
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _with_residual(self, context: Context, residuals: Samples) -> Samples:
        if not self._residual.HasValue(context):
            return ()
        return (*residuals, (context.get_time(), np.array(self._residual.Eval(context))))[-self._kept :]

    def _with_frames(self, context: Context, memory: _Memory) -> _Memory:
        """Return the memory with the frames that have arrived, and the cameras' status."""
        now, cameras = context.get_time(), list(memory.cameras)
        stamps = self._frames.fresh(context, [camera.stamp for camera in cameras], self._params.memory)
        for k, camera in enumerate(cameras):
            if k not in stamps and now - camera.arrived > self._params.timeout + 1e-9:
                cameras[k] = CameraMemory(camera.arrived, camera.stamp, CameraStatus.STALE)
        if not stamps:
            return replace(memory, cameras=tuple(cameras))
        newest = max(stamps.values())
        at, views = self._instant(context, memory, newest), []
        if self._contact.HasValue(context) and self._contact.Eval(context)[0] <= 0.5 and at.r is not None:
            memory = replace(memory, quiet=(memory.quiet or QuietNoise(0.0 * at.r)).after(at.r))
        for k, stamp in stamps.items():
            sample, repeats = cameras[k].repeated(self._frames.depth(context, k))
            frozen, view = 0 < self._params.frozen_frames <= repeats, self._look(context, k, at)
            status = CameraStatus.INVALID if view is None or not frozen else CameraStatus.STALE
            cameras[k] = CameraMemory(now, stamp, status, sample=sample, repeats=repeats)
            if view is not None and not frozen:
                cameras[k] = CameraMemory(now, stamp, CameraStatus.OK, view.places, view.person.points, sample, repeats)
                views.append(view)
        memory = replace(memory, cameras=tuple(cameras), stamp=newest)
        if not views:
            return memory
        places = [camera.places for camera in memory.cameras]
        return replace(memory, known=self._way.after(memory.known, views, at, places))

    def _instant(self, context: Context, memory: _Memory, stamp: float) -> Instant:
        """Return the robot at a time, with the mean residual around that time if there is one."""
        averaged, r = self._params.averaged, np.full(self._robot.n, np.nan)
        if memory.residuals:
            last = min(stamp + 0.5 * averaged, context.get_time()) + 1e-9
            around = [sample for time, sample in memory.residuals if last - averaged < time <= last]
            r = np.mean(around, axis=0) if around else sample_at(memory.residuals, stamp)
        at = instant(self._robot, stamp, sample_at(memory.postures, stamp), r if np.isfinite(r).all() else None)
        told = self._noise.Eval(context) if self._noise.HasValue(context) else np.full(self._robot.n, np.nan)
        raised, quiet = memory.known.raised, memory.quiet or QuietNoise(np.zeros(0))
        return at._replace(sigma=raised * quiet.deviation(self._least_noise, told), raised=raised)

    def _look(self, context: Context, k: int, at: Instant) -> View | None:
        """Return what a camera's frame shows, if it can be used."""
        depth = self._frames.depth(context, k)
        if depth is None or not np.all(np.isfinite(at.p_WL)):
            return None
        finder, port = self._finders[k], self._corrections[k]
        finder = finder.corrected(port.Eval(context)) if port.HasValue(context) else finder
        view = finder.look(depth, at.R_WL, at.p_WL, self._way.places)
        return view if view.person.seen >= self._params.least_seen else None
