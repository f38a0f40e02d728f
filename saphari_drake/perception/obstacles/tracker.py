"""ObstacleTracker: what a depth camera sees besides robot and background, as few obstacle points with velocities."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, EventStatus, LeafSystem, State

from saphari_drake.messages import Immutable, ObstaclePoints, ObstacleStatus
from saphari_drake.perception.camera.frames import DepthFrames, Samples, sample_at
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.obstacles.tracks import (
    NO_TRACKS,
    ObstacleTrackerParameters,
    Tracks,
    update_tracks,
    voxel_means,
)
from saphari_drake.perception.segmentation.parameters import SegmentationParameters
from saphari_drake.perception.segmentation.robot_filter import Depth, RobotFilter
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_outputs

Array = NDArray[np.float64]

_UNKNOWN = ObstaclePoints(status=ObstacleStatus.LOST)


@dataclass(frozen=True)
class _Memory(Immutable):
    """All that changes. Never changed in place, so never copied."""

    postures: Samples = ()  # times (s) and joint positions (n,), oldest first
    stamp: float = -1.0  # s, when the last frame was taken
    tracks: Tracks = NO_TRACKS
    obstacles: ObstaclePoints = _UNKNOWN


class ObstacleTracker(LeafSystem):
    """Turns a camera's frames into obstacle points.

    .. pydrake_system::

        name: ObstacleTracker
        input_ports:
        - position_measured
        - depth_image
        - image_time
        output_ports:
        - obstacles
        - status

    Ports
    -----
    position_measured : n (rad or m), of all joints that move what the camera sees of the robot.
    depth_image : abstract `ImageDepth32F` (m; 0 and NaN: no reading, +inf: nothing in range).
    image_time : 1 (s), the time at which that image was taken; a change says that a frame has arrived.
    obstacles : abstract `ObstaclePoints`, world frame; stamped with the time of the frame.
    status : 1, their `ObstacleStatus` as a number.

    The robot, posed as it was at the frame's time stamp, and the static background are removed from the image
    (`RobotFilter`); what is left becomes obstacle points (`update_tracks`) in the middle of the body, half its
    thickness behind what is seen. Their radius covers what each stands for, from its near side to its far side.

    Status: OK when all points are seen in the last frame; HELD while one is held, or frames are late; LOST before the
    first frame, without one for `timeout`, and when a frame shows too little, has another size, or belongs to a posture
    that is not finite: then there are no points, and whoever needs them must stop.

    Parameters
    ----------
    robot : RobotModel
    camera : CameraParameters
        Of the camera that took the images.
    params : ObstacleTrackerParameters, optional
    vision : SegmentationParameters, optional
        How robot and background are removed.
    background : (height, width) float32 array, optional
        Static background, see `background_depth`; default: none in view.

    Raises
    ------
    ParameterError
        If the background has another size than the image.
    """

    def __init__(
        self,
        robot: RobotModel,
        camera: CameraParameters,
        params: ObstacleTrackerParameters | None = None,
        vision: SegmentationParameters | None = None,
        background: Depth | None = None,
    ) -> None:
        super().__init__()
        self._robot, self._params = robot, params or ObstacleTrackerParameters()
        self._filter = RobotFilter(robot.shapes, camera, vision or SegmentationParameters(), background)
        self._background = None if background is None else np.isfinite(background)
        self._frame_period = 1.0 / camera.rate
        self._kept = int(np.ceil((self._params.timeout + self._frame_period) / self._params.period)) + 2
        robot.kinematics(robot.home)  # compiles, as the next one does
        update_tracks(NO_TRACKS, np.zeros((1, 3)), np.zeros((1, 3)), self._frame_period, self._params)
        self._frames = DepthFrames(self, robot, [camera])
        self._state = self.DeclareAbstractState(AbstractValue.Make(_Memory()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)
        declare_outputs(
            self,
            self._memory,
            self.abstract_state_ticket(self._state),
            _Memory(),
            {"obstacles": lambda m: m.obstacles, "status": lambda m: [float(m.obstacles.status)]},
        )

    def _points(self, depth: Depth, q: Array) -> Array:
        """Return the points (k, 3) in the world that are neither robot nor background."""
        motion = self._robot.kinematics(q)
        return self._filter.person(depth, motion.R_WL, motion.p_WL).points

    def _memory(self, context: Context) -> _Memory:
        return context.get_abstract_state(int(self._state)).get_value()

    def _update(self, context: Context, state: State) -> EventStatus:
        params, memory, now = self._params, self._memory(context), context.get_time()
        memory = replace(memory, postures=self._frames.remember(context, memory.postures, self._kept))
        fresh = self._frames.fresh(context, [memory.stamp], params.timeout)
        if fresh:
            memory = self._with_frame(memory, self._frames.depth(context), fresh[0])
        elif now - memory.stamp > params.timeout + 1e-9:
            lost = ObstaclePoints(stamp=memory.stamp, status=ObstacleStatus.LOST)
            memory = replace(memory, tracks=NO_TRACKS, obstacles=lost)
        elif now - memory.stamp > 2.0 * self._frame_period and memory.obstacles.status == ObstacleStatus.OK:
            memory = replace(memory, obstacles=replace(memory.obstacles, status=ObstacleStatus.HELD))
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _with_frame(self, memory: _Memory, depth: Depth | None, stamp: float) -> _Memory:
        params, q = self._params, sample_at(memory.postures, stamp)
        if depth is None or not np.all(np.isfinite(q)) or self._blind(depth):
            lost = ObstaclePoints(stamp=stamp, status=ObstacleStatus.LOST)
            return replace(memory, stamp=stamp, tracks=NO_TRACKS, obstacles=lost)
        cloud = self._points(depth, q)
        surface = voxel_means(cloud[cloud[:, 2] > params.lowest], params.voxel)
        away = surface - self._filter.p_WC
        half = params.thickness * away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        elapsed = stamp - memory.stamp if memory.stamp >= 0.0 else self._frame_period
        tracks = update_tracks(memory.tracks, surface + half, half, elapsed, params)
        return replace(memory, stamp=stamp, tracks=tracks, obstacles=_published(tracks, stamp))

    def _blind(self, depth: Depth) -> bool:
        """Whether a frame shows too little of what it should show."""
        if self._background is None:
            readable = depth > 0.0
        else:
            readable = (depth > 0.0)[self._background] & np.isfinite(depth[self._background])
        return readable.size > 0 and float(np.mean(readable)) < self._params.least_seen


def _published(tracks: Tracks, stamp: float) -> ObstaclePoints:
    status = ObstacleStatus.HELD if np.any(tracks.unseen > 0.0) else ObstacleStatus.OK
    return ObstaclePoints(tracks.p_W, tracks.v_W, tracks.extent, stamp, status)
