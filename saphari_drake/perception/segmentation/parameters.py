"""The numbers by which robot and background are removed from depth images."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_positive


class Tuning(NamedTuple):
    """The fields of `SegmentationParameters` that compiled passes need."""

    reach: float
    seed_distance: float
    grow_distance: float
    scale_depth: float
    least_scale: float
    support: int
    support_step: float
    component: int
    points_stride: int


@dataclass
class SegmentationParameters:
    """How robot and background are removed. Distances (s) hold at `scale_depth` and grow with the depth squared."""

    # Distance around the robot within which the image is examined (m, > 0).
    reach: float = 0.12
    # Distance from the robot beyond which a reading surely is no robot (m, s, > grow_distance).
    seed_distance: float = 0.020
    # Distance beyond which a reading within 4 pixels of such a one is none either (m, s, > 0).
    grow_distance: float = 0.008
    # Margin before the background within which a reading counts as background (m, s, > 0).
    background_margin: float = 0.020
    # Depth at which (s) holds (m, > 0), and the least factor by which a smaller depth shrinks it (0–1).
    scale_depth: float = 1.7
    least_scale: float = 0.25
    # Least number of the person's pixels in a 5 × 5 window (1–25) at depths that differ by less than this (m, s, > 0).
    support: int = 7
    support_step: float = 0.03
    # Least number of the person's pixels in a connected component (≥ 1).
    component: int = 25
    # Spacing of the person's points that are published (pixels, ≥ 1).
    points_stride: int = 6

    def __post_init__(self) -> None:
        require_positive(
            self, "reach", "seed_distance", "grow_distance", "background_margin", "scale_depth", "least_scale",
            "support", "support_step", "component", "points_stride",
        )  # fmt: skip
        if self.grow_distance >= self.seed_distance:
            raise ParameterError("grow_distance", f"must be below seed_distance, got {self.grow_distance}")
        if self.least_scale > 1.0:
            raise ParameterError("least_scale", f"must not exceed 1, got {self.least_scale}")
        if self.support > 25:
            raise ParameterError("support", f"a window has 25 pixels, got {self.support}")

    @property
    def tuning(self) -> Tuning:
        """What compiled passes need."""
        return Tuning(**{name: getattr(self, name) for name in Tuning._fields})

    def scale(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the factor of the distances (s) at depths (m)."""
        return np.maximum((depth / self.scale_depth) ** 2, self.least_scale)
