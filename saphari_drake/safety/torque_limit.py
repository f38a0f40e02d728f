"""The last element before the joints: no torque beyond the limits, and none that is not a number."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.math.saturation import limit_torque
from saphari_drake.messages import SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


class _Output(NamedTuple):
    torque: Array
    excess: Array
    status: SystemStatus


class TorqueLimit(LeafSystem):
    """Cuts the commanded torque at the limits of the robot.

    .. pydrake_system::

        name: TorqueLimit
        input_ports:
        - torque_commanded
        output_ports:
        - torque_applied
        - torque_excess
        - system_status

    Ports
    -----
    torque_commanded : n (Nm or N).
    torque_applied : n (Nm or N), within ±tau_max of the robot. What drives the joints, and what observers are fed.
    torque_excess : n (Nm or N), what was cut off, commanded minus applied.
    system_status : 1, a `SystemStatus`; BAD_INPUT while the command is not finite. Then the last torque that was is
        applied, at the start that of the weight at home, with zero excess: a `CommandSwitch` before this system has a
        better answer.

    Parameters
    ----------
    robot : RobotModel
    period : float
        Period with which the last finite torque is remembered (s), that of the command.
    """

    def __init__(self, robot: RobotModel, period: float) -> None:
        super().__init__()
        if not 0.0 < period < np.inf:
            raise ParameterError("period", f"must be positive and finite, got {period}")
        self._tau_max = robot.tau_max
        weight, _ = limit_torque(evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).g, robot.tau_max)
        self._command = self.DeclareVectorInputPort("torque_commanded", BasicVector(robot.n))
        self._last = self.DeclareDiscreteState(weight)
        start = _Output(weight, np.zeros(robot.n), SystemStatus.OK)
        tickets = {self._command.ticket(), self.discrete_state_ticket(self._last)}
        self._output = declare_cache(self, "torque", start, self._evaluate, tickets)
        readouts = {
            "torque_applied": (robot.n, lambda o: o.torque),
            "torque_excess": (robot.n, lambda o: o.excess),
            "system_status": (1, lambda o: [float(o.status)]),
        }
        declare_readouts(self, self._output, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _evaluate(self, context: Context) -> _Output:
        command = self._command.Eval(context)
        if np.isfinite(command).all():
            return _Output(*limit_torque(command, self._tau_max), SystemStatus.OK)
        last = np.array(context.get_discrete_state(self._last).value())
        return _Output(last, np.zeros(len(last)), SystemStatus.BAD_INPUT)

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._last).SetFromVector(self._output.Eval(context).torque)
