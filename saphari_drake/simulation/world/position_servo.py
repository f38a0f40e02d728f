"""The position interface of a stiff arm, as a robot's own controller offers it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.math.saturation import limit_torque
from saphari_drake.parameters import require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class PositionServoParameters:
    """Gains of the arm's own servo; assumed."""

    # 1/s², 1/s; stiff: 200 rad/s, critically damped.
    stiffness: float = 40000.0
    damping: float = 400.0
    # s; period of the commands, over which the servo interpolates.
    period: float = 0.002

    def __post_init__(self) -> None:
        require_positive(self, "stiffness", "damping", "period")


class JointPositionServo(LeafSystem):
    """Makes the joints follow a position command; forces of hands are disturbances to it.

    .. pydrake_system::

        name: JointPositionServo
        input_ports:
        - state
        - position_commanded
        output_ports:
        - torque_commanded
        - torque_excess

    Ports
    -----
    state : 2n (rad or m, then rad/s or m/s), from the plant: the arm's own encoders at its own rate.
    position_commanded : n (rad or m), to be reached at the end of each period.
    torque_commanded : n (Nm or N), within the robot's limits: τ = M(K(q_r − q) + D(q̇_r − q̇)) + C q̇ + g, with q_r
        straight from one command to the next.
    torque_excess : n (Nm or N), what the limits cut off.

    State: the command before, and when the present one came.
    """

    def __init__(self, robot: RobotModel, params: PositionServoParameters | None = None) -> None:
        super().__init__()
        self._robot, self._params = robot, params or PositionServoParameters()
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * robot.n))
        self._command = self.DeclareVectorInputPort("position_commanded", BasicVector(robot.n))
        self._before = self.DeclareDiscreteState(robot.home)
        self._since = self.DeclareDiscreteState(1)
        tickets = {self._state.ticket(), self._command.ticket(), self.time_ticket(), self.xd_ticket()}
        none = np.zeros(robot.n)
        self._torques = declare_cache(self, "torques", (none, none), self._evaluate, tickets)
        readouts = {"torque_commanded": (robot.n, lambda t: t[0]), "torque_excess": (robot.n, lambda t: t[1])}
        declare_readouts(self, self._torques, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)

    def _evaluate(self, context: Context) -> tuple[Array, Array]:
        params, n, x = self._params, self._robot.n, self._state.Eval(context)
        terms = evaluate_dynamics(self._robot, x[:n], x[n:])
        before, command = context.get_discrete_state(self._before).value(), self._command.Eval(context)
        since = float(context.get_discrete_state(self._since).value()[0])
        share = min(max((context.get_time() - since) / params.period, 0.0), 1.0)
        q_r, v_r = before + share * (command - before), (command - before) / params.period
        torque = terms.M @ (params.stiffness * (q_r - terms.q) + params.damping * (v_r - terms.v)) + terms.Cv + terms.g
        return limit_torque(torque, self._robot.tau_max)

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._before).SetFromVector(self._command.Eval(context))
        state.get_mutable_discrete_state(self._since).SetFromVector([context.get_time()])
