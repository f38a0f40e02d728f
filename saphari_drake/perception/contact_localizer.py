"""ContactLocalizer: from the camera's frames and the measured posture to the point where a person touches the robot."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.leaf import cycle
from saphari_drake.perception.depth_frames import DepthFrames, Postures, link_poses, posture_at
from saphari_drake.perception.localization import (
    Array,
    ContactVision,
    Depth,
    Localization,
    LocalizerParameters,
    background_depth,
)
from saphari_drake.perception.rgbd_camera import CameraParameters
from saphari_drake.port_values import CameraStatus, ContactPoint, Immutable
from saphari_drake.robots.model import RobotModel

__all__ = ["ContactLocalizer", "ContactVision", "LocalizerParameters", "background_depth"]

_NOBODY = np.zeros((0, 3))


@dataclass(frozen=True)
class _Memory(Immutable):
    """All that changes. Never changed in place, so never copied."""

    postures: Postures  # times (s) and joint positions (n,), oldest first
    frame_time: float  # s, when the last frame arrived; before the first one, when the system started
    stamp: float = -1.0  # s, when the last frame was taken
    status: CameraStatus = CameraStatus.WAITING
    contact: ContactPoint = field(default_factory=ContactPoint)
    other_link: int = -1  # link that the last frames showed instead of the contact's
    other_count: int = 0  # and how many
    human_points: Array = field(default_factory=lambda: _NOBODY)


class ContactLocalizer(LeafSystem):
    """Finds the person's contact point on the robot in depth images.

    .. pydrake_system::

        name: ContactLocalizer
        input_ports:
        - position_measured
        - depth_image
        - image_time
        output_ports:
        - contact_point
        - camera_status
        - human_points

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    depth_image : abstract `ImageDepth32F` (m), from a `DepthCameraSampler`.
    image_time : 1 (s), the time at which that image was taken; a change says that a frame has arrived.
    contact_point : abstract `ContactPoint`, smoothed over frames.
    camera_status : 1, a `CameraStatus` as a number.
    human_points : abstract (k, 3) array, points of the person in the world (m) in the last frame.

    Every `period` the posture is remembered; when a frame has arrived, the posture at the frame's own time stamp poses
    the robot's shapes. The robot and the static background are removed from the image, and the contact point is a soft
    minimum over the rest (`ContactVision.localize`). `found` says that the person is nearer than `gate`; a contact of
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
        self._kept = int(np.ceil(self._params.memory / period)) + 1
        self._compile(camera)
        self._frames = DepthFrames(self, robot, camera)
        empty = _Memory((), 0.0)
        self._state = self.DeclareAbstractState(AbstractValue.Make(empty))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)
        ticket = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "contact_point",
            alloc=lambda: AbstractValue.Make(ContactPoint()),
            calc=lambda context, output: output.set_value(self._memory(context).contact),
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
        result = self._localize(depth, self._robot.home)
        self._vision.on_surface(int(max(result.link, self._robot.shapes.link.max())), np.zeros(3))

    def _localize(self, depth: Depth, q: Array) -> Localization:
        return self._vision.localize(depth, *link_poses(self._robot, q))

    def _memory(self, context: Context) -> _Memory:
        return context.get_abstract_state(int(self._state)).get_value()

    def _update(self, context: Context, state: State) -> EventStatus:
        memory, now = self._memory(context), context.get_time()
        frame_time = memory.frame_time if memory.postures else now
        memory = replace(
            memory, frame_time=frame_time, postures=self._frames.remember(context, memory.postures, self._kept)
        )
        stamp = self._frames.stamp(context)
        usable = 0.0 <= stamp <= now and now - stamp <= self._params.memory
        if usable and stamp != memory.stamp:
            seen = self._localize(self._frames.depth(context), posture_at(memory.postures, stamp))
            memory = self._with_frame(memory, seen, stamp, now)
        elif now - memory.frame_time > self._params.timeout + 1e-9:
            memory = replace(memory, status=CameraStatus.STALE, contact=ContactPoint(), human_points=_NOBODY)
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _with_frame(self, memory: _Memory, result: Localization, stamp: float, now: float) -> _Memory:
        memory = replace(memory, stamp=stamp, frame_time=now)
        if result.seen < self._params.least_seen:
            return replace(memory, status=CameraStatus.INVALID, contact=ContactPoint(), human_points=_NOBODY)
        memory = replace(memory, status=CameraStatus.OK, human_points=result.human_points)
        return self._with_contact(memory, result, stamp)

    def _with_contact(self, memory: _Memory, result: Localization, stamp: float) -> _Memory:
        """Smooth the point over frames; another link is taken when it was seen often enough in a row."""
        params, last = self._params, memory.contact
        if not (result.link >= 0 and result.distance < params.gate):
            return replace(memory, contact=ContactPoint(stamp=stamp), other_link=-1, other_count=0)
        p_LC, n_L = result.p_LC, result.n_L
        if last.found and result.link != last.link:
            count = memory.other_count + 1 if result.link == memory.other_link else 1
            if count < params.switch_frames:
                held = replace(last, distance=result.distance, stamp=stamp)
                return replace(memory, contact=held, other_link=result.link, other_count=count)
        elif last.found and np.linalg.norm(p_LC - last.p_LC) < params.jump:
            weight = -np.expm1(-(stamp - last.stamp) / params.time_constant)
            p_LC, n_L = self._vision.on_surface(result.link, last.p_LC + weight * (p_LC - last.p_LC))
        contact = ContactPoint(True, result.link, p_LC, n_L, result.distance, stamp)
        return replace(memory, contact=contact, other_link=-1, other_count=0)
