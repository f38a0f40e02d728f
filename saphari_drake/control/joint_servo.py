"""Velocity servo of the joints by computed torque."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.math.saturation import limit_torque
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class JointServoParameters:
    """Gains of the servo; A."""

    # 1/s, on the velocity error; above 0.5/period the sampling shows. One value for all joints: M is compensated.
    gain: float = 150.0
    # 0 … 1, share of the commanded acceleration, the change of command over a cycle, that is fed forward.
    feedforward: float = 1.0
    # s; the control cycle.
    period: float = 0.001

    def __post_init__(self) -> None:
        require_positive(self, "gain", "period")
        require_non_negative(self, "feedforward")


def servo_torque(terms: DynamicsTerms, v_desired: Array, a_desired: Array, gain: float) -> Array:
    """Return τ = M (a_d + K (q̇_d − q̇)) + C q̇ + g, (n,) in Nm.

    Closed loop without other forces: d(q̇ − q̇_d)/dt = −K (q̇ − q̇_d), each joint for itself. A gain per joint without
    M blows up on a light wrist.

    Parameters
    ----------
    terms : DynamicsTerms
    v_desired, a_desired : (n,) arrays
        Desired velocity and acceleration.
    gain : float
        K (1/s).
    """
    return terms.M @ (a_desired + gain * (v_desired - terms.v)) + terms.Cv + terms.g


class _Output(NamedTuple):
    torque: Array
    excess: Array
    error: Array


class JointVelocityServo(LeafSystem):
    """Makes the joints follow a velocity command.

    .. pydrake_system::

        name: JointVelocityServo
        input_ports:
        - dynamics
        - velocity_commanded
        output_ports:
        - torque_commanded
        - torque_excess
        - velocity_error

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of the measured state.
    velocity_commanded : n (rad/s or m/s).
    torque_commanded : n (Nm or N), within the robot's limits.
    torque_excess : n, what the limits cut off.
    velocity_error : n (rad/s or m/s), commanded minus measured.

    The law is `servo_torque`. State: the command of the cycle before, for the acceleration fed forward; none is in the
    first cycle, so that a command that does not start at zero is approached with the gain alone.
    """

    def __init__(self, robot: RobotModel, params: JointServoParameters | None = None) -> None:
        super().__init__()
        self._robot, self._params = robot, params or JointServoParameters()
        terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(robot.n))
        self._before = self.DeclareDiscreteState(robot.n)
        self._begun = self.DeclareDiscreteState(1)
        start = _Output(terms.g, np.zeros(robot.n), np.zeros(robot.n))
        tickets = {
            self._dynamics.ticket(),
            self._command.ticket(),
            self.discrete_state_ticket(self._before),
            self.discrete_state_ticket(self._begun),
        }
        self._output = declare_cache(self, "torque", start, self._evaluate, tickets)
        declare_readouts(
            self,
            self._output,
            {
                "torque_commanded": (robot.n, lambda o: o.torque),
                "torque_excess": (robot.n, lambda o: o.excess),
                "velocity_error": (robot.n, lambda o: o.error),
            },
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)

    def _evaluate(self, context: Context) -> _Output:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        v_desired = np.array(self._command.Eval(context))
        before = context.get_discrete_state(self._before).value()
        begun = context.get_discrete_state(self._begun).value()[0]
        a_desired = begun * self._params.feedforward * (v_desired - before) / self._params.period
        torque, excess = limit_torque(servo_torque(terms, v_desired, a_desired, self._params.gain), self._robot.tau_max)
        return _Output(torque, excess, v_desired - terms.v)

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._before).SetFromVector(self._command.Eval(context))
        state.get_mutable_discrete_state(self._begun).SetFromVector([1.0])
