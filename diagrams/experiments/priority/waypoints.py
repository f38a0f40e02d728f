"""A path through waypoints."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.math.curves import quintic

Array = NDArray[np.float64]


class WaypointPath:
    """Straight lines through points at a mean speed, at rest at each of them.

    Parameters
    ----------
    points : sequence of (3,) arrays
        The first is the start (m).
    speed : float
        Mean speed on each line (m/s).
    dwell : float
        Rest after each line (s).

    Attributes
    ----------
    arrivals : list of float
        End of the rest at each point but the first (s).
    """

    def __init__(self, points: Sequence[ArrayLike], speed: float, dwell: float) -> None:
        self._points = [np.asarray(point, dtype=float) for point in points]
        lengths = [float(np.linalg.norm(b - a)) for a, b in zip(self._points, self._points[1:])]
        if not lengths or min(lengths) <= 0.0 or not speed > 0.0 or not dwell >= 0.0:
            raise ParameterError("waypoints", "a path needs two points that differ, a speed > 0 and a dwell ≥ 0")
        self._times = [length / speed for length in lengths]
        self.arrivals = list(np.cumsum([time + dwell for time in self._times]))

    def __call__(self, time: float) -> tuple[Array, Array]:
        """Return position (3,) and velocity (3,) at a time."""
        leg = min(int(np.searchsorted(self.arrivals, time, side="right")), len(self._times) - 1)
        begin, duration = (self.arrivals[leg - 1] if leg else 0.0), self._times[leg]
        share, rate, _ = quintic((time - begin) / duration)
        step = self._points[leg + 1] - self._points[leg]
        return self._points[leg] + share * step, rate / duration * step
