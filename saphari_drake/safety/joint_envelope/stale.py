"""Whether a command comes from a controller that is dead."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Repeated(NamedTuple):
    """A command, the measured state that came with it, and for how long (s) it was the same while the state changed.

    A controller that lives answers what it measures: bit for bit the same command again and again, while positions or
    velocities change, comes from none. Where nothing changes, nothing is known.
    """

    command: Array
    state: Array
    time: float = 0.0
    q_hold: Array | None = None  # positions held since it was stale

    def after(self, command: Array, q: Array, v: Array, period: float, stale_time: float) -> Repeated:
        """Return what is known one period later."""
        state = np.concatenate((q, v))
        if not np.array_equal(command, self.command, equal_nan=True):
            return Repeated(np.array(command), state)
        time = self.time + (0.0 if np.array_equal(state, self.state) else period)
        stale = time >= stale_time or not np.isfinite(command).all()
        return Repeated(self.command, state, time, (q if self.q_hold is None else self.q_hold) if stale else None)
