"""Speed and separation monitoring as a system behind whatever commands velocities."""

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.tree import REVOLUTE
from saphari_drake.robots.dynamics import DynamicsTerms
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.nearness import Balls, posed, surface_of
from saphari_drake.safety.speed_scale import SpeedScale
from saphari_drake.safety.speed_separation.law import Separation, permitted_scale
from saphari_drake.safety.speed_separation.parameters import SpeedSeparationParameters
from saphari_drake.safety.speed_separation.stopping import StoppingTable, extension_of, stopping_of

Array = NDArray[np.float64]
_UNKNOWN = Separation(0.0, np.nan, np.nan, -1, -1)


class SpeedSeparation(SpeedScale):
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
    status : 1, a `ScaleStatus`; the scale is 0 while people, state or command are not known.

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
        self._params, self._table = params or SpeedSeparationParameters(), table or stopping_of(robot)
        self._surface, self._axis = surface_of(robot), int(np.argmax(robot.tree.kind == REVOLUTE))
        readouts = {
            "separation": (1, lambda found: [found.distance]),
            "protective_distance": (1, lambda found: [found.protective]),
        }
        super().__init__(robot, self._params.people_timeout, _UNKNOWN, readouts)

    def _scaled(self, terms: DynamicsTerms, v: Array, people: Balls, age: float) -> Separation:
        p_WS = posed(self._surface, terms.motion)[1]
        extension = extension_of(p_WS, terms.p_WL[self._axis], self._table.reach)
        rule = self._params.rule(age)
        return Separation(*permitted_scale(self._surface, terms.motion, v, people, rule, self._table.row(extension)))
