"""What power and force limiting assumes of people, and what can clamp them."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.primitives import BOX
from saphari_drake.parameters import require_non_negative, require_positive, require_vector

Array = NDArray[np.float64]
BODY = ("neck", "back", "chest", "abdomen", "pelvis", "upper_arm", "forearm", "hand", "thigh", "lower_leg")


@dataclass
class Structure:
    """A box of the surroundings that can clamp a person, its edges along the axes of the world."""

    # m, world; its middle and its edges.
    middle: list[float] = field(default_factory=lambda: [0.0, 0.0, -0.05])
    size: list[float] = field(default_factory=lambda: [20.0, 20.0, 0.1])

    def __post_init__(self) -> None:
        require_vector(self, 3, "middle", "size")
        require_positive(self, "size")


@dataclass
class PowerForceParameters:
    """Limits of a contact, and where they hold."""

    # File of the regions' limits; empty: that of this library.
    regions_file: str = ""
    # Regions that a point below the head can belong to: no camera tells which, and the strictest one counts.
    regions: list[str] = field(default_factory=lambda: list(BODY))
    # m; what is seen this far below the top of a person counts as the head, and m, horizontally, what belongs to one
    # person. 0: nobody's head can be touched. Assumed.
    head_height: float = 0.30
    person_width: float = 0.50
    # m; people farther than this from the robot do not count: they are not touched before it is told again.
    reach: float = 0.15
    # What can clamp a person beside the robot itself: the floor.
    structures: list[Structure] = field(default_factory=lambda: [Structure()])
    # m; gap that is left where a person still counts as clamped, and the thickest part of the body that can be.
    clamp_gap: float = 0.02
    thickest: float = 0.30
    # m/s; what comes nearer more slowly counts as at rest.
    still: float = 1e-3
    # s; people seen longer ago than this count as lost.
    people_timeout: float = 0.2

    def __post_init__(self) -> None:
        require_positive(self, "person_width", "thickest", "still", "people_timeout")
        require_non_negative(self, "head_height", "reach", "clamp_gap")


class Walls(NamedTuple):
    """Structures as primitives."""

    kind: NDArray[np.int64]
    size: Array
    R: Array
    p: Array


def walls_of(structures: list[Structure]) -> Walls:
    """Return structures as the law takes them."""
    count = len(structures)
    middle = np.array([item.middle for item in structures], dtype=float).reshape(-1, 3)
    half = 0.5 * np.array([item.size for item in structures], dtype=float).reshape(-1, 3)
    return Walls(np.full(count, BOX), half, np.tile(np.eye(3), (count, 1, 1)), middle)
