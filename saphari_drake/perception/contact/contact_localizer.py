"""ContactLocalizer: from the camera's frames and the measured posture to the point where a person touches the robot."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.messages import CameraStatus, ContactPoint, Immutable
from saphari_drake.perception.camera.frames import DepthFrames, Postures, posture_at
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.correction import instant
from saphari_drake.perception.contact.track import ContactTrack, ContactTracker
from saphari_drake.perception.contact.vision import Array, ContactVision, Depth, LocalizerParameters, background_depth
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle

__all__ = ["ContactLocalizer", "ContactVision", "LocalizerParameters", "background_depth"]

_NOBODY = np.zeros((0, 3))


@dataclass(frozen=True)
class _Memory(Immutable):
    """All that changes. Never changed in place, so never copied."""

    postures: Postures  # times (s) and joint positions (n,), oldest first
    residuals: Postures  # the same of the residual (n,); empty if that is not connected
    frame_time: float  # s, when the last frame arrived; before the first one, when the system started
    stamp: float = -1.0  # s, when the last frame was taken
    status: CameraStatus = CameraStatus.WAITING
    track: ContactTrack = field(default_factory=ContactTrack)
    human_points: Array = field(default_factory=lambda: _NOBODY)


class ContactLocalizer(LeafSystem):
    """Finds the person's contact point on the robot in depth images.

    .. pydrake_system::

        name: ContactLocalizer
        input_ports:
        - position_measured
        - depth_image
        - image_time
        - residual
        output_ports:
        - contact_point
        - camera_status
        - human_points

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    depth_image : abstract `ImageDepth32F` (m), from a `DepthCameraSampler`.
    image_time : 1 (s), the time at which that image was taken; a change says that a frame has arrived.
    residual : n (Nm), optional, from `MomentumObserver`; vetoes a contact point that it contradicts.
    contact_point : abstract `ContactPoint`, smoothed over frames.
    camera_status : 1, a `CameraStatus` as a number.
    human_points : abstract (k, 3) array, points of the person in the world (m) in the last frame.

    Every `period` the posture is remembered; when a frame has arrived, the posture at the frame's own time stamp poses
    the robot's shapes. The robot and the static background are removed from the image, and the rest is explained as
    something thin or as a limb that touches (`ContactVision.localize_several`); `ContactTracker` chooses over frames,
    with the residual of the same time. `found` says that the person is nearer than `gate`; a contact of
    which the camera sees nothing is not found. With a camera that is not OK, no contact is found.

    Parameters
    ----------
    robot : RobotModel
    camera : CameraParameters
        Of the camera that took the images.
    params : LocalizerParameters, optional
    background : (height, width) float32 array, optional
        Static background, see `background_depth`; default: none in view.
    period : float
        Time between looks at the inputs (s).

    Raises
    ------
    StateError
        At an update, if the measured position is not finite.
    """

    def __init__(
        self,
        robot: RobotModel,
        camera: CameraParameters,
        params: LocalizerParameters | None = None,
        background: Depth | None = None,
        period: float = 0.005,
    ) -> None:
        super().__init__()
        if not 0.0 < period < np.inf:
            raise ParameterError("period", f"must be positive and finite, got {period}")
        self._robot, self._params = robot, params or LocalizerParameters()
        self._vision = ContactVision(robot.shapes, camera, self._params, background)
        self._tracker = ContactTracker(robot, self._params, self._vision.on_surface)
        self._kept = int(np.ceil(self._params.memory / period)) + 1
        self._compile(camera)
        self._frames = DepthFrames(self, robot, camera)
        self._residual = self.DeclareVectorInputPort("residual", BasicVector(robot.n))
        empty = _Memory((), (), 0.0)
        self._state = self.DeclareAbstractState(AbstractValue.Make(empty))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)
        ticket = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "contact_point",
            alloc=lambda: AbstractValue.Make(ContactPoint()),
            calc=lambda context, output: output.set_value(self._memory(context).track.contact),
            prerequisites_of_calc=ticket,
        )
        self.DeclareVectorOutputPort(
            "camera_status",
            BasicVector(1),
            lambda context, output: output.SetAtIndex(0, float(self._memory(context).status)),
            prerequisites_of_calc=ticket,
        )
        self.DeclareAbstractOutputPort(
            "human_points",
            alloc=lambda: AbstractValue.Make(_NOBODY),
            calc=lambda context, output: output.set_value(self._memory(context).human_points),
            prerequisites_of_calc=ticket,
        )

    def _compile(self, camera: CameraParameters) -> None:
        """Localize in an image that shows something everywhere, which compiles every kernel."""
        depth = np.full((camera.height, camera.width), camera.near, dtype=np.float32)
        at = instant(self._robot, 0.0, self._robot.home, np.full(self._robot.n, 100.0))
        seen = self._vision.localize_several(depth, at.R_WL, at.p_WL, 1)
        link = int(max(seen[0].link, self._robot.shapes.link.max()))
        self._tracker.after(ContactTrack(), [seen[0]._replace(link=link)], at)

    def _memory(self, context: Context) -> _Memory:
        return context.get_abstract_state(int(self._state)).get_value()

    def _update(self, context: Context, state: State) -> EventStatus:
        memory, now = self._memory(context), context.get_time()
        memory = replace(
            memory,
            frame_time=memory.frame_time if memory.postures else now,
            postures=self._frames.remember(context, memory.postures, self._kept),
            residuals=self._with_residual(context, memory.residuals),
        )
        stamp = self._frames.stamp(context)
        usable = 0.0 <= stamp <= now and now - stamp <= self._params.memory
        if usable and stamp != memory.stamp:
            memory = self._with_frame(memory, self._frames.depth(context), stamp, now)
        elif now - memory.frame_time > self._params.timeout + 1e-9:
            memory = replace(memory, status=CameraStatus.STALE, track=ContactTrack(), human_points=_NOBODY)
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _with_residual(self, context: Context, residuals: Postures) -> Postures:
        if not self._residual.HasValue(context):
            return ()
        return (*residuals, (context.get_time(), np.array(self._residual.Eval(context))))[-self._kept :]

    def _with_frame(self, memory: _Memory, depth: Depth, stamp: float, now: float) -> _Memory:
        r = posture_at(memory.residuals, stamp) if memory.residuals else None
        at = instant(self._robot, stamp, posture_at(memory.postures, stamp), r)
        seen = self._vision.localize_several(depth, at.R_WL, at.p_WL, 1)
        memory = replace(memory, stamp=stamp, frame_time=now)
        if seen[0].seen < self._params.least_seen:
            return replace(memory, status=CameraStatus.INVALID, track=ContactTrack(), human_points=_NOBODY)
        track = self._tracker.after(memory.track, seen, at)
        return replace(memory, status=CameraStatus.OK, track=track, human_points=seen[0].human_points)
