"""Speed and separation monitoring as a system behind whatever commands velocities."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from saphari_drake.math.tree import REVOLUTE
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.nearness import NOBODY, Balls, balls_of, posed, surface_of
from saphari_drake.safety.speed_separation.law import Separation, SeparationStatus, permitted_scale
from saphari_drake.safety.speed_separation.parameters import SpeedSeparationParameters
from saphari_drake.safety.speed_separation.stopping import StoppingTable, extension_of, stopping_of
from saphari_drake.systems import declare_cache, declare_readouts

Array = NDArray[np.float64]


class _Output(NamedTuple):
    v: Array
    found: Separation
    status: SeparationStatus


class SpeedSeparation(LeafSystem):
    """Scales a joint velocity so that people keep the protective separation distance.

    .. pydrake_system::

        name: SpeedSeparation
        input_ports:
        - dynamics
        - velocity_commanded
        - people
        output_ports:
        - velocity_applied
        - speed_scale
        - separation
        - protective_distance
        - status

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of the measured state.
    velocity_commanded : n (rad/s or m/s).
    people : abstract `ObstaclePoints`, of cameras; optional: nobody.
    velocity_applied : n (rad/s or m/s), the command times `speed_scale`; a `VelocityEnvelope` comes after it.
    speed_scale : 1, from 0 to 1.
    separation : 1 (m), of the pair that scales, or of the one with the least left; infinite where nobody is.
    protective_distance : 1 (m), of that pair at the full command.
    status : 1, a `SeparationStatus`; the scale is 0 while people, state or command are not known.

    Law: `permitted_scale`. It monitors the standard's distance, which ends as soon as the robot stands: people may then
    come to it. It has no memory.

    Parameters
    ----------
    robot : RobotModel
    params : SpeedSeparationParameters, optional
    table : StoppingTable, optional
        Stopping times of the robot; default: those stored beside its model.

    Raises
    ------
    ModelError
        If there is no such table.
    """

    def __init__(
        self,
        robot: RobotModel,
        params: SpeedSeparationParameters | None = None,
        table: StoppingTable | None = None,
    ) -> None:
        super().__init__()
        self._params, self._table = params or SpeedSeparationParameters(), table or stopping_of(robot)
        self._surface, n = surface_of(robot), robot.n
        terms = evaluate_dynamics(robot, robot.home, np.zeros(n))
        self._axis = int(np.argmax(robot.tree.kind == REVOLUTE))
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(n))
        self._people = self.DeclareAbstractInputPort("people", AbstractValue.Make(ObstaclePoints()))
        self._scaled(terms, np.zeros(n), NOBODY, 0.0)  # compiles
        start = _Output(np.zeros(n), Separation(1.0, np.inf, 0.0, -1, -1), SeparationStatus.FREE)
        tickets = {self.all_input_ports_ticket(), self.time_ticket()}
        output = declare_cache(self, "separation", start, self._evaluate, tickets)
        readouts = {
            "velocity_applied": (n, lambda o: o.v),
            "speed_scale": (1, lambda o: [o.found.scale]),
            "separation": (1, lambda o: [o.found.distance]),
            "protective_distance": (1, lambda o: [o.found.protective]),
            "status": (1, lambda o: [float(o.status)]),
        }
        declare_readouts(self, output, readouts)

    def _scaled(self, terms: DynamicsTerms, v: Array, people: Balls, age: float) -> Separation:
        p_WS = posed(self._surface, terms.motion)[1]
        extension = extension_of(p_WS, terms.p_WL[self._axis], self._table.reach)
        rule = self._params.rule(age)
        return Separation(*permitted_scale(self._surface, terms.motion, v, people, rule, self._table.row(extension)))

    def _evaluate(self, context: Context) -> _Output:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        v, none = np.array(self._command.Eval(context)), Separation(0.0, np.nan, np.nan, -1, -1)
        if not terms.finite or not np.isfinite(v).all():
            return _Output(np.zeros(len(v)), none, SeparationStatus.BAD_INPUT)
        people, age = NOBODY, 0.0
        if self._people.HasValue(context):
            points = self._people.Eval(context)
            age = points.age(context.get_time())
            known = balls_of(points) if age <= self._params.people_timeout else None
            if known is None:
                return _Output(0.0 * v, none, SeparationStatus.PEOPLE_LOST)
            people = known
        found = self._scaled(terms, v, people, age)
        moves = SeparationStatus.SLOWED if found.scale > 0.0 else SeparationStatus.STOPPED
        return _Output(found.scale * v, found, SeparationStatus.FREE if found.scale == 1.0 else moves)
