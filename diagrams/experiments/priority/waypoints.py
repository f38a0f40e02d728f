"""A path through waypoints."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.world.references import rest_to_rest

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
        rows = np.asarray(points, dtype=float)
        lengths = np.linalg.norm(np.diff(rows, axis=0), axis=1)
        if len(lengths) == 0 or lengths.min() <= 0.0 or not speed > 0.0 or not dwell >= 0.0:
            raise ParameterError("waypoints", "a path needs two points that differ, a speed > 0 and a dwell ≥ 0")
        self.arrivals: list[float] = np.cumsum(lengths / speed + dwell).tolist()
        starts = np.array([0.0, *self.arrivals[:-1]])
        times = np.column_stack([starts, starts + lengths / speed]).ravel()
        self._path = rest_to_rest(times, np.column_stack([rows[:-1], rows[1:]]).reshape(len(times), -1))
        self._velocity = self._path.MakeDerivative()

    def __call__(self, time: float) -> tuple[Array, Array]:
        """Return position (3,) and velocity (3,) at a time."""
        return self._path.value(time).ravel(), self._velocity.value(time).ravel()
