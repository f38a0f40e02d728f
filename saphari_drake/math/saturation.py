"""The last element before the joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import StateError

Array = NDArray[np.float64]


def limit_torque(torque: Array, tau_max: Array) -> tuple[Array, Array]:
    """Return the torque within ±tau_max, and what was cut off (both (n,), Nm).

    Raises
    ------
    StateError
        If the torque is not finite, which clipping would pass on.
    """
    if not np.isfinite(torque).all():
        raise StateError(f"torque: not finite: {torque.tolist()}")
    limited = np.minimum(np.maximum(torque, -tau_max), tau_max)  # at this size a third of the time of np.clip
    return limited, torque - limited
