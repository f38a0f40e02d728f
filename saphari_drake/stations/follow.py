"""Runs a diagram by the clock of a robot."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from pydrake.systems.analysis import Simulator

from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.priority import undisturbed
from saphari_drake.stations.process import StationProcess
from saphari_drake.systems import CYCLE_OFFSET

WAIT = 1.0e-4  # s, between two looks at the robot's clock


class Followed(NamedTuple):
    """How a diagram kept up with a robot."""

    time: float  # s, of the diagram at its end
    cycles: int
    late: int  # cycles that were done more than a period after their time
    longest: float  # s, that one cycle took
    running: bool  # whether the robot was still there at the end


def follow(
    simulator: Simulator,
    station: StationProcess,
    params: StationParameters,
    duration: float,
    until: Callable[[], bool] = lambda: False,
) -> Followed:
    """Advance a simulator cycle by cycle, each when the robot's clock has come to it, for `duration` (s).

    Ends early if the robot is lost or `until()` is true. A cycle that is late is done at once: the diagram's time is
    never behind the robot's for longer than its work takes.
    """
    simulator.Initialize()
    with undisturbed(params.diagram_priority):
        return _follow(simulator, station, params.period, duration, until)


def _follow(
    simulator: Simulator, station: StationProcess, period: float, duration: float, until: Callable[[], bool]
) -> Followed:
    start, cycles, late, longest = station.time(), 0, 0, 0.0
    while (cycles + 1) * period <= duration + 1e-9 and not until():
        due = (cycles + 1) * period
        while station.time() - start < due:
            if not station.running:
                return Followed(cycles * period, cycles, late, longest, False)
            time.sleep(WAIT)
        began = time.perf_counter()
        simulator.AdvanceTo(due + 3.0 * CYCLE_OFFSET)
        longest = max(longest, time.perf_counter() - began)
        cycles += 1
        late += station.time() - start > due + period
    return Followed(cycles * period, cycles, late, longest, station.running)
