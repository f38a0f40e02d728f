"""How far a residual is from zero while nobody touches: the deviation that a felt touch is weighed by."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FIRST, _LAST = 5.0, 60.0  # frames that what is assumed counts as, and over which the deviation is measured


class QuietNoise(NamedTuple):
    """Mean square of a residual in frames without a touch."""

    square: Array  # (n,)
    frames: float = 0.0

    def after(self, r: Array) -> QuietNoise:
        """Return the mean with the residual r (n,) of one more frame."""
        frames = min(self.frames + 1.0, _LAST)
        return QuietNoise(self.square + (r**2 - self.square) / frames, frames)

    def deviation(self, least: float, told: Array) -> Array:
        """Return the deviation (n,), at least `least`, which is assumed as long as little is measured.

        Without a frame it is what is told (n,), where that is finite and larger.
        """
        if not self.frames:
            return np.where(np.isfinite(told), np.maximum(told, least), least)
        square = (self.frames * self.square + _FIRST * least**2) / (self.frames + _FIRST)
        return np.maximum(np.sqrt(square), least)
