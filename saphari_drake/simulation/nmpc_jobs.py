"""Jobs of the predictive control: test points, obstacles and references of Section 3."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PointOnLink(NamedTuple):
    """A point of the robot that keeps a distance.

    Attributes
    ----------
    name : str
    link : str
        Link, by name, whose frame the offset is given in.
    offset : tuple of 3 floats
        Position in the link frame (m).
    d_min : float
        Distance to keep (m).
    c : float
        Weight of the barrier (20) (m²).
    """

    name: str
    link: str
    offset: tuple[float, float, float]
    d_min: float
    c: float


# The arm's points are where the published problem has them, on its Denavit-Hartenberg frames: its frames 1, 3 and 5 sit
# at the far end of our links 1, 3 and 5; the frames 2, 4, 6 and 7 are our own.
ARM_POINTS = (
    PointOnLink("shoulder", "link_1", (0.0, 0.0, 0.2005), 0.2, 1e-4),
    PointOnLink("upper_arm", "link_2", (0.0, 0.0, 0.2), 0.2, 1e-4),
    PointOnLink("elbow", "link_3", (0.0, 0.0, 0.2), 0.2, 1e-4),
    PointOnLink("forearm_1", "link_4", (0.0, 0.0, 0.13), 0.2, 1e-4),
    PointOnLink("forearm_2", "link_4", (0.0, 0.0, 0.26), 0.2, 1e-4),
    PointOnLink("wrist", "link_5", (0.0, 0.0, 0.19), 0.2, 1e-4),
    PointOnLink("hand", "link_6", (0.0, 0.0, 0.04), 0.2, 1e-4),
    PointOnLink("flange", "link_7", (0.0, 0.0, 0.0), 0.2, 1e-4),
)
OMNIROB_POINTS = (
    PointOnLink("platform_front", "platform", (0.3, 0.0, 0.35), 0.6, 5e-4),
    PointOnLink("platform_rear", "platform", (-0.3, 0.0, 0.35), 0.6, 5e-4),
    *ARM_POINTS,
)

# m, world; (x, y, z) of the six obstacles of Fig. 2.
OBSTACLES: Array = np.array(
    [
        [-0.36, 2.55, 0.20],
        [1.00, 3.15, 0.25],
        [0.14, 2.70, 1.27],
        [-0.24, 2.95, 1.10],
        [0.05, 3.10, 0.95],
        [-0.05, 2.80, 1.52],
    ]
)
