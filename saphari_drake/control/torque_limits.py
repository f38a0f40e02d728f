"""The last element before the joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def limit_torque(torque: Array, tau_max: Array) -> tuple[Array, Array]:
    """Return the torque within ±tau_max, and what was cut off (both (n,), Nm)."""
    limited = np.clip(torque, -tau_max, tau_max)
    return limited, torque - limited
