"""What all systems share that scale a joint velocity by where people are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.nearness import NOBODY, Balls, balls_of
from saphari_drake.systems import declare_cache, declare_readouts

Array = NDArray[np.float64]


class ScaleStatus(IntEnum):
    """What becomes of a speed, also published as a number."""

    FREE = 0  # it is passed on
    REDUCED = 1  # it is scaled down
    STOPPED = 2  # people leave none
    PEOPLE_LOST = 3  # people are not known: zero
    BAD_INPUT = 4  # state or command are not finite: zero


class _Output(NamedTuple):
    v: Array
    found: Any
    status: ScaleStatus


class SpeedScale(LeafSystem):
    """A joint velocity times a factor; what derives from it says which, and what else it found.

    Parameters
    ----------
    robot : RobotModel
    people_timeout : float
        s; people who were seen longer ago are lost.
    unknown
        What is found while people, state or command are not known, a named tuple with a `scale` of 0.
    readouts : mapping
        Further outputs, each with its size and how it is read from what is found.
    """

    def __init__(
        self,
        robot: RobotModel,
        people_timeout: float,
        unknown: Any,
        readouts: Mapping[str, tuple[int, Callable[[Any], Any]]],
    ) -> None:
        super().__init__()
        self._people_timeout, self._nothing = people_timeout, unknown
        n, terms = robot.n, evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(n))
        self._people = self.DeclareAbstractInputPort("people", AbstractValue.Make(ObstaclePoints()))
        start = _Output(np.zeros(n), self._scaled(terms, np.zeros(n), NOBODY, 0.0), ScaleStatus.FREE)  # compiles
        tickets = {self.all_input_ports_ticket(), self.time_ticket()}
        output = declare_cache(self, "scaled", start, self._evaluate, tickets)
        declare_readouts(
            self,
            output,
            {
                "velocity_applied": (n, lambda o: o.v),
                "speed_scale": (1, lambda o: [o.found.scale]),
                **{name: (size, _of_found(read)) for name, (size, read) in readouts.items()},
                "status": (1, lambda o: [float(o.status)]),
            },
        )

    def _scaled(self, terms: DynamicsTerms, v: Array, people: Balls, age: float) -> Any:
        """Return what is found for a velocity (n,) and people who were seen `age` (s) ago, with the `scale`."""
        raise NotImplementedError

    def _evaluate(self, context: Context) -> _Output:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        v, people, age = np.array(self._command.Eval(context)), NOBODY, 0.0
        if not terms.finite or not np.isfinite(v).all():
            return _Output(np.zeros(len(v)), self._nothing, ScaleStatus.BAD_INPUT)
        if self._people.HasValue(context):
            points: ObstaclePoints = self._people.Eval(context)
            age = points.age(context.get_time())
            known = balls_of(points) if age <= self._people_timeout else None
            if known is None:
                return _Output(0.0 * v, self._nothing, ScaleStatus.PEOPLE_LOST)
            people = known
        found = self._scaled(terms, v, people, age)
        left = ScaleStatus.REDUCED if found.scale > 0.0 else ScaleStatus.STOPPED
        return _Output(found.scale * v, found, ScaleStatus.FREE if found.scale == 1.0 else left)


def _of_found(read: Callable[[Any], Any]) -> Callable[[_Output], Any]:
    return lambda output: read(output.found)
