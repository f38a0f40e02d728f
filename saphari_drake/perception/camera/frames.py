"""Inputs of a system that looks at depth frames of a robot, and the robot at the time of each frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.robots.kinematics import Kinematics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Depth = NDArray[np.float32]
Samples = tuple[tuple[float, Array], ...]  # times (s) and values (n,), oldest first


class DepthFrames:
    """Ports of a system that sees a robot with one camera or more; holds constants only.

    `position_measured` (n, rad or m), and for each camera `depth_image` (abstract `ImageDepth32F`, m) and `image_time`
    (1, s); with several cameras ``depth_image_0``, ``image_time_0``, ``depth_image_1`` and so on.
    """

    def __init__(self, system: LeafSystem, robot: RobotModel, cameras: Sequence[CameraParameters]) -> None:
        self._position = system.DeclareVectorInputPort("position_measured", BasicVector(robot.n))
        self._ports, self._sizes = [], []
        for k, camera in enumerate(cameras):
            image = Value[ImageDepth32F](ImageDepth32F(camera.width, camera.height))
            end = f"_{k}" if len(cameras) > 1 else ""
            port = system.DeclareAbstractInputPort(f"depth_image{end}", image)
            self._ports.append((port, system.DeclareVectorInputPort(f"image_time{end}", BasicVector(1))))
            self._sizes.append((camera.height, camera.width))

    def remember(self, context: Context, postures: Samples, kept: int) -> Samples:
        """Return the last `kept` postures with the measured one."""
        return (*postures, (context.get_time(), np.array(self._position.Eval(context))))[-kept:]

    def fresh(self, context: Context, last: Sequence[float], oldest: float) -> dict[int, float]:
        """Return when the images were taken (s) of the cameras that have a new one, no older than `oldest` (s).

        `last` holds when the images were taken that are known already (s). A stamp that is not finite, or lies in the
        future, is none.
        """
        now = context.get_time()
        stamps = {k: float(time.Eval(context)[0]) for k, (_, time) in enumerate(self._ports)}
        return {k: s for k, s in stamps.items() if last[k] < s and 0.0 <= s <= now and now - s <= oldest}

    def depth(self, context: Context, camera: int = 0) -> Depth | None:
        """Return the image (height, width) of a camera in m, valid during this evaluation; none of another size."""
        image = self._ports[camera][0].Eval(context).data[..., 0]
        return image if image.shape == self._sizes[camera] else None


def sample_at(samples: Samples, time: float) -> Array:
    """Return the values (n,) at a time (s), interpolated; NaN beside a sample that is not finite."""
    times = np.array([entry[0] for entry in samples])
    columns = np.array([entry[1] for entry in samples]).T
    return np.array([np.interp(time, times, column) for column in columns])


class Instant(NamedTuple):
    """A robot when a frame was taken."""

    stamp: float  # s
    motion: Kinematics  # at rest
    r: Array | None = None  # (n,) residual, Nm
    sigma: Array | None = None  # (n,) its deviation where it was measured, Nm
    raised: float = 1.0  # by what that is larger than while nobody touches

    @property
    def R_WL(self) -> Array:
        """Orientations of the links, (n, 3, 3)."""
        return self.motion.R_WL

    @property
    def p_WL(self) -> Array:
        """Positions of the links (m), (n, 3)."""
        return self.motion.p_WL

    def jacobian(self, link: int, p_L: Array) -> Array:
        """Return the Jacobian (3, n), in the world, of a point p_L (m) of a link."""
        return self.motion.point(link, p_L).Jv_WC

    def felt(self, least: float) -> bool:
        """Whether the norm of the residual is above `least` (Nm)."""
        return self.r is not None and bool(np.linalg.norm(self.r) > least)


def instant(robot: RobotModel, stamp: float, q: Array, r: Array | None = None) -> Instant:
    """Return a robot at joint positions q (n,), with the residual r (n,) of the same time."""
    return Instant(stamp, robot.kinematics(q), r)
