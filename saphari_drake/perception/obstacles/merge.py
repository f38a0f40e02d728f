"""What several cameras see, as one set of obstacle points."""

from __future__ import annotations

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.systems import declare_cache, declare_outputs


class MergedObstacles(LeafSystem):
    """Joins the obstacle points of several sources.

    .. pydrake_system::

        name: MergedObstacles
        input_ports:
        - (each source: obstacles_0, obstacles_1, …)
        output_ports:
        - obstacles
        - status

    Ports
    -----
    (each source) : abstract `ObstaclePoints`, world frame.
    obstacles : abstract `ObstaclePoints`, those of all sources; as old as the oldest, and LOST if one is lost: what one
        camera sees, another may not.
    status : 1, their `ObstacleStatus` as a number.

    What two cameras see twice is there twice. It has no memory.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        if count < 1:
            raise ParameterError("count", f"must be at least 1, got {count}")
        none = AbstractValue.Make(ObstaclePoints())
        self._ports = [self.DeclareAbstractInputPort(f"obstacles_{k}", none) for k in range(count)]
        start = ObstaclePoints(status=ObstacleStatus.LOST)
        joined = declare_cache(self, "obstacles", start, self._joined, {self.all_input_ports_ticket()})
        reads = {"obstacles": lambda points: points, "status": lambda points: [float(points.status)]}
        declare_outputs(self, joined.Eval, joined.ticket(), start, reads)

    def _joined(self, context: Context) -> ObstaclePoints:
        parts: list[ObstaclePoints] = [port.Eval(context) for port in self._ports]
        status, stamp = max(part.status for part in parts), min(part.stamp for part in parts)
        if status == ObstacleStatus.LOST:
            return ObstaclePoints(stamp=stamp, status=ObstacleStatus.LOST)
        p, v, radius = (np.concatenate([getattr(part, x) for part in parts]) for x in ("p_WO", "v_WO", "radius"))
        return ObstaclePoints(p, v, radius, stamp, status)
