"""An arm that follows velocity commands exactly, signals sampled once a cycle, and paths through waypoints."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.math.curves import quintic
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import CYCLE_OFFSET, cycle

Array = NDArray[np.float64]


class KinematicArm(LeafSystem):
    """Integrates a velocity command, held over each cycle.

    .. pydrake_system::

        name: KinematicArm
        input_ports:
        - velocity_commanded
        output_ports:
        - position_measured

    Ports
    -----
    velocity_commanded : n (rad/s or m/s).
    position_measured : n (rad or m), held over each cycle; q ← q + T q̇ at its end. Starts at the home posture.
    """

    def __init__(self, robot: RobotModel, period: float) -> None:
        super().__init__()
        self._period = period
        self._velocity = self.DeclareVectorInputPort("velocity_commanded", BasicVector(robot.n))
        self._position = self.DeclareDiscreteState(robot.home)
        self.DeclareStateOutputPort("position_measured", self._position)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _update(self, context: Context, state: State) -> None:
        q = context.get_discrete_state(self._position).value()
        v = self._velocity.Eval(context)
        state.get_mutable_discrete_state(self._position).SetFromVector(q + self._period * v)


class SampledSignal(LeafSystem):
    """Holds the value of a function of time over each cycle.

    .. pydrake_system::

        name: SampledSignal
        output_ports:
        - value

    Ports
    -----
    value : size of what ``function(t)`` returns, sampled at the start of each cycle.
    """

    def __init__(self, function: Callable[[float], ArrayLike], period: float) -> None:
        super().__init__()
        self._function = function
        self._held = self.DeclareDiscreteState(self._sample(0.0))
        self.DeclareStateOutputPort("value", self._held)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._update)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _sample(self, time: float) -> Array:
        return np.asarray(self._function(time), dtype=float).ravel()

    def _update(self, context: Context, state: State) -> None:
        value = self._sample(max(context.get_time() - CYCLE_OFFSET, 0.0))
        state.get_mutable_discrete_state(self._held).SetFromVector(value)


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
