"""How the robot stops, and how far people come meanwhile."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.math.primitives import BOX
from saphari_drake.math.tree import PRISMATIC, Tree
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.power_force.parameters import PowerForceParameters
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters, bounds_of

Array = NDArray[np.float64]
# A ramp that turns from +A to −A is followed with jerk J within this times A/J.
_TURN = 1.5


@dataclass
class VerifiedStopParameters:
    """What a stop has to cope with."""

    # The stop: accelerations that the motors surely give, cycle, lag and margins to the limits of the joints.
    motion: VelocityEnvelopeParameters = field(default_factory=VelocityEnvelopeParameters)
    # Whether a `VelocityEnvelope` with the same motion comes after it, whose jerk lets a stop begin later.
    envelope_behind: bool = False
    # m/s, with which people come nearer. ISO 13855: 1.6 walking, 2.0 with a hand; a point does not tell which it is.
    person_speed: float = 2.0
    # m, error of a person's points. Assumed.
    person_error: float = 0.02
    # m, kept from people as far as they can reach, and from things.
    separation: float = 0.0
    thing_separation: float = 0.01
    # m, by which the links are elsewhere than the positions say, as by the lag of the joints. Assumed.
    tracking_error: float = 0.005
    # s; people and things seen longer ago than this count as lost, and commands made longer ago as well.
    people_timeout: float = 0.5
    command_timeout: float = 0.25
    # Whether people may be touched while the robot moves, as softly as `contact` has it; its `reach` is not used.
    touch: bool = False
    contact: PowerForceParameters = field(default_factory=PowerForceParameters)
    # Intervals of a stop, each checked as a whole (≥ 1).
    intervals: int = 10

    def __post_init__(self) -> None:
        require_positive(self, "people_timeout", "command_timeout")
        require_non_negative(self, "person_speed", "person_error", "separation", "thing_separation", "tracking_error")
        if self.intervals < 1:
            raise ParameterError("intervals", f"must be at least 1, got {self.intervals}")


class Body(NamedTuple):
    """The robot, as the check sees it: rounded boxes on the links that move, and how it stops."""

    tree: Tree
    link: NDArray[np.int64]  # (s,)
    half: Array  # (s, 3), half sizes (m) of the boxes, which the rounding is added to
    rounding: Array  # (s,)
    R_LS: Array  # (s, 3, 3)
    p_LS: Array  # (s, 3)
    reach: Array  # (s, n), fastest that a point of the shape moves at unit speed of a joint (m or 1)
    q_min: Array  # (n,)
    q_max: Array
    v_max: Array
    deceleration: Array
    period: float  # s
    hold: float  # s, for which a velocity lasts before the stop shows, beyond the period


def body_of(robot: RobotModel, params: VerifiedStopParameters) -> Body:
    """Return the robot as the check sees it. A cylinder counts as the capsule around it.

    Raises
    ------
    ModelError, ParameterError
        As `bounds_of` does.
    """
    bounds, shapes = bounds_of(robot, params.motion), robot.shapes
    rise = bounds.acceleration / bounds.jerk
    moving = np.flatnonzero(shapes.link >= 0)
    boxes = shapes.kind[moving] == BOX
    size = shapes.size[moving]
    half = np.where(boxes[:, None], size, np.column_stack([0.0 * size[:, 0], 0.0 * size[:, 0], size[:, 1]]))
    rounding = np.where(boxes, 0.0, size[:, 0])
    extent = np.linalg.norm(shapes.p_LS[moving], axis=1) + np.linalg.norm(half, axis=1) + rounding
    return Body(
        robot.tree,
        shapes.link[moving],
        np.ascontiguousarray(half),
        rounding,
        np.ascontiguousarray(shapes.R_LS[moving]),
        np.ascontiguousarray(shapes.p_LS[moving]),
        np.array([_reach(robot, link, size) for link, size in zip(shapes.link[moving], extent)]).reshape(-1, robot.n),
        bounds.q_min,
        bounds.q_max,
        bounds.v_max,
        bounds.acceleration,
        bounds.period,
        params.motion.lag + 0.5 * bounds.period + params.envelope_behind * _TURN * float(rise.max()),
    )


def _reach(robot: RobotModel, link: int, extent: float) -> Array:
    """Return how far (m) a point of a link can be from each joint's axis; 1 for prismatic joints, 0 for later ones."""
    tree, row = robot.tree, np.zeros(robot.n)
    while link >= 0:
        extent += float(np.linalg.norm(tree.p_ML[link]))
        if tree.kind[link] == PRISMATIC:
            row[link] = 1.0
            extent += float(max(abs(robot.q_min[link]), abs(robot.q_max[link])))
        else:
            row[link] = extent
        extent += float(np.linalg.norm(tree.p_PF[link]))
        link = int(tree.parent[link])
    return row
