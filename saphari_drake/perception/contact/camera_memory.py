"""What a localizer remembers of one camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.messages import CameraStatus
from saphari_drake.perception.contact.places import Place

Array = NDArray[np.float64]
Depth = NDArray[np.float32]

NOBODY = np.zeros((0, 3))
_SIDE = 60  # pixels along the shorter side of an image that tell whether a frame is the last one again


class CameraMemory(NamedTuple):
    """What is known of one camera."""

    arrived: float  # s, when the last frame arrived; before the first one, when the system started
    stamp: float = -1.0  # s, when it was taken
    status: CameraStatus = CameraStatus.WAITING
    places: Sequence[Place] = ()
    points: Array = NOBODY  # (k, 3) m, of the person in the world
    sample: Depth | None = None  # some pixels of the last frame (m)
    repeats: int = 0  # frames since that were equal to it

    def repeated(self, depth: Depth | None) -> tuple[Depth | None, int]:
        """Return pixels of a new frame, and for how many frames they have been the same, bit for bit."""
        step = 1 if depth is None else max(1, min(depth.shape) // _SIDE)
        sample = None if depth is None else depth[::step, ::step].copy()
        same = sample is not None and self.sample is not None and np.array_equal(sample, self.sample, equal_nan=True)
        return sample, self.repeats + 1 if same else 0
