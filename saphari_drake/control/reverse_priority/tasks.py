"""Tasks and unilateral constraints of a priority stack as small objects.

A *component* says what of the robot is meant. A *task* brings one to a reference, a *bound* keeps one in a range; a
list of bounds is a level of constraints. Hard or soft is a matter of the place in the stack: bounds are hard for the
levels after them and soft for those before.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
Triple = tuple[float, float, float]


class Kind(IntEnum):
    """What a component measures."""

    JOINT = 0  # q_index, rad or m
    PLANE = 1  # a·p_WC − length, m, a in the world: signed distance to a plane
    DISTANCE = 2  # ‖p_WC − p_WO‖ − length, m, to the target O with that index
    VIEW = 3  # cosine of the angle at p_WC between the axis a (in the link) and the ray to the target with that index
    TURN = 4  # rotation of a frame about the world's axis with that index, rad; of tasks alone


@dataclass(frozen=True)
class Component:
    """A scalar component x_C(q) of a robot; use the functions below."""

    name: str
    kind: Kind
    unit: str
    link: int = -1  # that the point belongs to; −1: the world
    p_LC: Triple = (0.0, 0.0, 0.0)
    index: int = 0
    direction: Triple = (0.0, 0.0, 0.0)
    length: float = 0.0
    R_LF: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def joint_coordinate(robot: RobotModel, joint: str) -> Component:
    """Position of a joint (rad or m)."""
    return Component(joint, Kind.JOINT, "rad", index=robot.joint_index(joint))


def plane_distance(
    robot: RobotModel, frame: str, normal: ArrayLike, offset: float = 0.0, p_FC: ArrayLike = (0, 0, 0)
) -> Component:
    """Signed distance n·p − offset (m) of a point of a frame to a plane of the world, such as a virtual wall."""
    link, p_LC = fixed_point(robot, frame, p_FC)
    return Component(f"{frame} to plane", Kind.PLANE, "m", link, p_LC, 0, _unit(normal, "normal"), float(offset))


def target_distance(
    robot: RobotModel, frame: str, target: int, radius: float = 0.0, p_FC: ArrayLike = (0, 0, 0)
) -> Component:
    """Distance (m) of a point of a frame to a moving target, less a radius (of the target, the link, or both)."""
    link, p_LC = fixed_point(robot, frame, p_FC)
    name = f"{frame} to target {target}"
    return Component(name, Kind.DISTANCE, "m", link, p_LC, _target(target), length=float(radius))


def view_cosine(robot: RobotModel, frame: str, target: int, axis: ArrayLike = (0, 0, 1)) -> Component:
    """Cosine of the angle between the optical axis (in a camera's frame) and the ray from there to a moving target.

    A lower bound of cos(half the field of view) keeps the target in the image.
    """
    link, p_LC = fixed_point(robot, frame, (0, 0, 0))
    R_LF = robot.frame(frame)[1].rotation().matrix()
    direction = _triple(R_LF @ np.array(_unit(axis, "axis")))
    return Component(f"{frame} view of target {target}", Kind.VIEW, "1", link, p_LC, _target(target), direction)


@dataclass(frozen=True)
class Bound:
    """Unilateral constraints lower ≤ x_C ≤ upper with a smooth activation; either side may be infinite.

    Attributes
    ----------
    component : Component
    lower, upper : float
        Range, in the unit of the component.
    buffer : float
        β_p, how far inside the range the activation begins.
    velocity_buffer : float
        β_v, velocity away from the bound at which the constraint is released.
    gain : float
        1/s, rate of the way back from outside the range.
    """

    component: Component
    lower: float = -np.inf
    upper: float = np.inf
    buffer: float = 0.05
    velocity_buffer: float = 0.1
    gain: float = 10.0

    def __post_init__(self) -> None:
        require_positive(self, "buffer", "velocity_buffer")
        require_non_negative(self, "gain")
        if not self.lower <= self.upper:
            raise ParameterError(
                "lower", f"{self.component.name}: {self.lower} lies above the upper bound {self.upper}"
            )
        if not (np.isfinite(self.lower) or np.isfinite(self.upper)):
            raise ParameterError("lower", f"{self.component.name}: neither bound is finite")


def joint_limits(robot: RobotModel, margin: float = 0.0, buffer: float = 0.1, gain: float = 10.0) -> list[Bound]:
    """Return the position limits of all joints that have any, moved inwards by a margin (rad or m)."""
    bounds = []
    for name, low, high in zip(robot.joint_names, robot.q_min, robot.q_max, strict=True):
        if np.isfinite(low) or np.isfinite(high):
            bounds.append(Bound(joint_coordinate(robot, name), low + margin, high - margin, buffer, gain=gain))
    return bounds


@dataclass(frozen=True)
class FrameTask:
    """Brings a frame, or some of its coordinates, to a reference: position, orientation or both.

    Attributes
    ----------
    name : str
    link : int
    p_LC, R_LF : tuples
        Pose of the frame in the link.
    axes : tuple of int
        Which of the rows [ω_x, ω_y, ω_z, v_x, v_y, v_z] (world) the task has.
    gain : float
        1/s, on the error.
    """

    name: str
    link: int
    p_LC: Triple
    R_LF: tuple[float, ...]
    axes: tuple[int, ...]
    gain: float = 10.0

    def __post_init__(self) -> None:
        require_non_negative(self, "gain")
        if not self.axes or set(self.axes) - set(range(6)) or len(set(self.axes)) < len(self.axes):
            raise ParameterError("axes", f"needs different numbers of 0 … 5, got {self.axes}")

    def rows(self) -> list[tuple[Component, int, int]]:
        """Return of each axis the component, and where in the reference its desired value and velocity are."""
        rows = []
        for axis in self.axes:
            unit = (float(axis == 3), float(axis == 4), float(axis == 5))
            kind = (Kind.TURN, "rad") if axis < 3 else (Kind.PLANE, "m")
            component = Component(self.name, *kind, self.link, self.p_LC, axis % 3, unit, R_LF=self.R_LF)
            rows.append((component, axis + 6, axis + 12))
        return rows


@dataclass(frozen=True)
class ScalarTask:
    """Brings a component to a reference.

    Attributes
    ----------
    component : Component
    gain : float
        1/s, on the error.
    """

    component: Component
    gain: float = 10.0

    def __post_init__(self) -> None:
        require_non_negative(self, "gain")

    def rows(self) -> list[tuple[Component, int, int]]:
        """Return the component, and where in the reference its desired value and velocity are."""
        return [(self.component, 0, 1)]


Task = FrameTask | ScalarTask
Level = Task | Sequence[Bound]


def position_task(robot: RobotModel, frame: str, axes: str = "xyz", gain: float = 10.0) -> FrameTask:
    """Return the task of a frame's origin, or of some of its world coordinates (`ParameterError` for other `axes`)."""
    if not axes or set(axes) - set("xyz"):
        raise ParameterError("axes", f"needs some of x, y and z, got '{axes}'")
    return _frame_task(robot, frame, tuple(3 + "xyz".index(axis) for axis in axes), gain)


def pose_task(robot: RobotModel, frame: str, gain: float = 10.0) -> FrameTask:
    """Return the task of a frame's orientation and position; the orientation error lives on SO(3)."""
    return _frame_task(robot, frame, (0, 1, 2, 3, 4, 5), gain)


def _frame_task(robot: RobotModel, frame: str, axes: tuple[int, ...], gain: float) -> FrameTask:
    link, X_LF = robot.frame(frame)
    R_LF = tuple(float(value) for value in X_LF.rotation().matrix().ravel())
    return FrameTask(frame, link, _triple(X_LF.translation()), R_LF, axes, gain)


def fixed_point(robot: RobotModel, frame: str, p_FC: ArrayLike) -> tuple[int, Triple]:
    """Return the link that a frame belongs to, and a point of the frame in that link."""
    link, X_LF = robot.frame(frame)
    return link, _triple(X_LF @ np.asarray(p_FC, dtype=float))


def _triple(values: ArrayLike) -> Triple:
    x, y, z = np.asarray(values, dtype=float)
    return float(x), float(y), float(z)


def _unit(direction: ArrayLike, name: str) -> Triple:
    vector = np.asarray(direction, dtype=float)
    length = np.linalg.norm(vector)
    if vector.shape != (3,) or not np.isfinite(length) or length < 1e-9:
        raise ParameterError(name, f"needs three numbers that are not all zero, got {vector.tolist()}")
    return _triple(vector / length)


def _target(index: int) -> int:
    if index < 0:
        raise ParameterError("target", f"must not be negative, got {index}")
    return index
