"""Inputs of a system that looks at depth frames of a robot, and the posture that belongs to each frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Depth = NDArray[np.float32]
Postures = tuple[tuple[float, Array], ...]  # times (s) and joint positions (n,), oldest first


class DepthFrames:
    """Ports `position_measured` (n), `depth_image` (abstract ImageDepth32F) and `image_time` (1, s) of a system.

    Holds constants only.
    """

    def __init__(self, system: LeafSystem, robot: RobotModel, camera: CameraParameters) -> None:
        self._robot = robot
        image = Value[ImageDepth32F](ImageDepth32F(camera.width, camera.height))
        self._position = system.DeclareVectorInputPort("position_measured", BasicVector(robot.n))
        self._image = system.DeclareAbstractInputPort("depth_image", image)
        self._time = system.DeclareVectorInputPort("image_time", BasicVector(1))

    def remember(self, context: Context, postures: Postures, kept: int) -> Postures:
        """Return the last `kept` postures with the measured one; raise `StateError` if that is not finite."""
        q = self._robot.checked_vector(self._position.Eval(context), "position_measured")
        return (*postures, (context.get_time(), q))[-kept:]

    def stamp(self, context: Context) -> float:
        """Return when the image was taken (s)."""
        return float(self._time.Eval(context)[0])

    def depth(self, context: Context) -> Depth:
        """Return the depth image (height, width) in m; valid during this evaluation."""
        return self._image.Eval(context).data[..., 0]


def posture_at(postures: Sequence[tuple[float, Array]], time: float) -> Array:
    """Return the joint positions (n,) at a time (s), interpolated between remembered ones."""
    times = np.array([entry[0] for entry in postures])
    columns = np.array([entry[1] for entry in postures]).T
    return np.array([np.interp(time, times, column) for column in columns])


def link_poses(robot: RobotModel, q: Array) -> tuple[Array, Array]:
    """Return R_WL (n, 3, 3) and p_WL (n, 3) of all links at joint positions `q` (n,)."""
    motion = robot.kinematics(q)
    return motion.R_WL, motion.p_WL
