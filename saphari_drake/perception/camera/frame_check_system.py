"""FrameCheck: watches every frame of a camera, and says when it is not to be trusted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.messages import CameraStatus, Immutable
from saphari_drake.perception.camera.frame_check import (
    FrameCheckParameters,
    FrameFigures,
    FrameStatus,
    SurfacePoints,
    background_figures,
    robot_offsets,
    surface_points,
)
from saphari_drake.perception.camera.frames import DepthFrames, Samples, sample_at
from saphari_drake.perception.camera.model import CameraParameters, camera_pose
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]
Depth = NDArray[np.float32]
_OLDEST = 0.2  # s, age of a frame that arrives


@dataclass(frozen=True)
class _Memory(Immutable):
    postures: Samples = ()  # times (s) and joint positions (n,), oldest first
    stamp: float = -1.0  # s, of the last frame
    status: FrameStatus = FrameStatus.OK
    bad: int = 0  # frames in a row
    good: int = 0


class FrameCheck(LeafSystem):
    """Compares each frame with the background and with the robot's model.

    .. pydrake_system::

        name: FrameCheck
        input_ports:
        - position_measured
        - depth_image
        - image_time
        - camera_status
        output_ports:
        - camera_status
        - status

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    depth_image, image_time : abstract `ImageDepth32F` (m) and 1 (s), of the camera.
    camera_status (input) : 1, a `CameraStatus`, of who reads the same frames.
    camera_status (output) : 1, the same; INVALID instead of OK while the frames are not to be trusted.
    status : 1, a `FrameStatus`.

    A person is in front of robot and background, never behind: readings through the robot, or nearly all of the
    background at another depth, come from a camera that was moved. A shift along a floor that fills the view, while
    nothing of the robot is seen, cannot be noticed. A patch is blind if the background has readings there.
    `frames` bad ones in a row decide, `good_frames` good ones end it.

    Parameters
    ----------
    robot : RobotModel
    camera : CameraParameters
    params : FrameCheckParameters, optional
    background : (height, width) float32 array, optional
        As `background_depth` gives it; without it only the robot is looked at.
    period : float
        Time between looks at the inputs (s).

    Raises
    ------
    ParameterError
        If the period is not positive, or the background has another size than the image.
    """

    def __init__(
        self,
        robot: RobotModel,
        camera: CameraParameters,
        params: FrameCheckParameters | None = None,
        background: Depth | None = None,
        period: float = 0.005,
    ) -> None:
        super().__init__()
        if not 0.0 < period < np.inf:
            raise ParameterError("period", f"must be positive and finite, got {period}")
        size = (camera.height, camera.width)
        if background is not None and background.shape != size:
            raise ParameterError("background", f"needs the image's shape {size}, got {background.shape}")
        self._robot, self._params = robot, params or FrameCheckParameters()
        self._background = np.full(size, np.inf, np.float32) if background is None else background
        self._points = surface_points(robot, int(self._params.points)) if robot.shapes.count else None
        X_WC = camera_pose(camera)
        self._R_WC, self._p_WC = X_WC.rotation().matrix(), np.array(X_WC.translation())
        self._optics = (camera.focal_x, camera.focal_y, *map(float, camera.center))
        self._remembered = int(np.ceil(_OLDEST / period)) + 1
        self._frames = DepthFrames(self, robot, [camera])
        self._camera = self.DeclareVectorInputPort("camera_status", BasicVector(1))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)
        state = self.abstract_state_ticket(self._memory)
        trusted = declare_cache(self, "trusted", 0.0, self._trusted, {state, self._camera.ticket()})
        declare_readouts(self, trusted, {"camera_status": (1, lambda status: [status])})
        status = declare_cache(self, "status", FrameStatus.OK, lambda context: self._kept(context).status, {state})
        declare_readouts(self, status, {"status": (1, lambda status: [float(status)])})
        self.figures(np.zeros(size, np.float32), robot.home)  # compiles

    def figures(self, image: Depth, q: Array) -> FrameFigures:
        """Return what a frame shows, with the robot at q (n,)."""
        p = self._params
        image = image.view()
        image.flags.writeable = False  # as a port gives it: compiled passes know it by that
        tuning = int(p.stride), int(p.tile), p.sigma, p.sigma_depth, p.tile_share
        blind, noise, floor = background_figures(image, self._background, tuning)
        if self._points is None or not np.isfinite(q).all():
            return FrameFigures(blind, noise, floor, np.nan, np.nan)
        p_C, n_C = self._in_camera(self._points, q)
        found, through = robot_offsets(image, p_C, n_C, self._optics, p.through, p.sigma, p.sigma_depth)
        if len(found) < p.least_points:
            return FrameFigures(blind, noise, floor, np.nan, np.nan)
        near = found[found < 0.05]
        return FrameFigures(blind, noise, floor, float(np.median(near)) if len(near) else np.nan, through)

    def _in_camera(self, points: SurfacePoints, q: Array) -> tuple[Array, Array]:
        motion = self._robot.kinematics(q)
        R_WL = np.concatenate((motion.R_WL, np.eye(3)[None]))[points.link]  # index −1 picks the world
        p_WL = np.concatenate((motion.p_WL, np.zeros((1, 3))))[points.link]
        p_W = p_WL + np.einsum("kij,kj->ki", R_WL, points.p_L)
        return (p_W - self._p_WC) @ self._R_WC, np.einsum("kij,kj->ki", R_WL, points.n_L) @ self._R_WC

    def _kept(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _trusted(self, context: Context) -> float:
        status = float(self._camera.Eval(context)[0])
        doubted = self._kept(context).status != FrameStatus.OK and status == CameraStatus.OK
        return float(CameraStatus.INVALID) if doubted else status

    def _update(self, context: Context, state: State) -> EventStatus:
        memory = self._kept(context)
        postures = self._frames.remember(context, memory.postures, self._remembered)
        fresh = self._frames.fresh(context, [memory.stamp], _OLDEST)
        image = self._frames.depth(context) if fresh else None
        if image is None:
            memory = _Memory(postures, memory.stamp, memory.status, memory.bad, memory.good)
        else:
            seen = self.figures(image, sample_at(postures, fresh[0])).status(self._params)
            bad = memory.bad + 1 if seen != FrameStatus.OK else 0
            good = memory.good + 1 if seen == FrameStatus.OK else 0
            status = seen if bad >= self._params.frames else memory.status
            status = FrameStatus.OK if good >= self._params.good_frames else status
            memory = _Memory(postures, fresh[0], status, bad, good)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
        return EventStatus.Succeeded()
