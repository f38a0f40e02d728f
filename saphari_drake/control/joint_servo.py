"""Velocity servo of the joints by computed torque."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import Immutable, SystemStatus, status_of
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]
_GIVEN = 0.01  # share of a joint's torque limit within which a torque counts as given


@dataclass
class JointServoParameters:
    """Gains of the servo; assumed."""

    # 1/s, on the velocity error; above 0.5/period the sampling shows. One value for all joints: M is compensated.
    gain: float = 150.0
    # 0 … 1, share of the commanded acceleration, the change of command over a cycle, that is fed forward.
    feedforward: float = 1.0
    # 1/s², on the velocity error's integral, so that friction and a wrong model do not hold a joint back; a quarter of
    # the gain's square damps critically. 0: none.
    integral_gain: float = 0.0
    # rad or m; largest integral.
    integral_limit: float = 0.02
    # s; the control cycle.
    period: float = 0.001

    def __post_init__(self) -> None:
        require_positive(self, "gain", "integral_limit", "period")
        require_non_negative(self, "feedforward", "integral_gain")


def servo_torque(
    terms: DynamicsTerms, v_desired: Array, a_desired: Array, gain: float, viscous: Array | float = 0.0
) -> Array:
    """Return τ = M (a_d + K (q̇_d − q̇)) + C q̇ + g + D_v q̇_d, (n,) in Nm.

    Closed loop without other forces: d(q̇ − q̇_d)/dt = −K (q̇ − q̇_d), each joint for itself. A gain per joint without
    M blows up on a light wrist.

    Parameters
    ----------
    terms : DynamicsTerms
    v_desired, a_desired : (n,) arrays
        Desired velocity and acceleration.
    gain : float
        K (1/s).
    viscous : (n,) array or float
        D_v, friction of the joints (Nms/rad).
    """
    return terms.M @ (a_desired + gain * (v_desired - terms.v)) + terms.Cv + terms.g + viscous * v_desired


class _Output(NamedTuple):
    torque: Array
    error: Array
    status: SystemStatus


@dataclass(frozen=True)
class _Memory(Immutable):
    gravity: Array  # at the last known state
    integral: Array  # rad or m, of the velocity error
    command: Array | None = None  # of the cycle before


class JointVelocityServo(LeafSystem):
    """Makes the joints follow a velocity command.

    .. pydrake_system::

        name: JointVelocityServo
        input_ports:
        - dynamics
        - velocity_commanded
        - torque_applied
        output_ports:
        - torque_commanded
        - velocity_error
        - system_status

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of the measured state.
    velocity_commanded : n (rad/s or m/s).
    torque_applied : n (Nm or N), given in place of the torque that is asked for; optional: just that. No output depends
        on it.
    torque_commanded : n (Nm or N), always finite; `TorqueLimit` comes after it. A `VelocityEnvelope` before the servo
        keeps it within the limits.
    velocity_error : n (rad/s or m/s), commanded minus measured; NaN while the state is not known.
    system_status : 1, a `SystemStatus`. BAD_INPUT while the command is not finite: the joints are braked. BRAKES_ON
        while the state is not known: the gravity torque of the last known one is left, at the start that at home.

    The law is `servo_torque`, with the integral of the velocity error in the desired acceleration. State: that
    integral, nothing after an input that was not finite, which does not grow while the joints get another torque than
    is asked for: behind a limit, or while another law holds the robot, it would wind up; and the command of the cycle
    before, for the acceleration fed forward; none is in the first cycle, so that a command that does not start at zero
    is approached by the gain alone.
    """

    def __init__(self, robot: RobotModel, params: JointServoParameters | None = None) -> None:
        super().__init__()
        self._params, zero = params or JointServoParameters(), np.zeros(robot.n)
        terms = evaluate_dynamics(robot, robot.home, zero)
        self._dynamics = DynamicsInput(self, terms)
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(robot.n))
        self._applied = self.DeclareVectorInputPort("torque_applied", BasicVector(robot.n))
        self._tolerance, self._viscous = _GIVEN * robot.tau_max, robot.viscous
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory(terms.g, zero)))
        start = _Output(terms.g, zero, SystemStatus.OK)
        tickets = {self._dynamics.ticket(), self._command.ticket(), self.abstract_state_ticket(self._memory)}
        self._output = declare_cache(self, "torque", start, self._evaluate, tickets)
        readouts = {
            "torque_commanded": (robot.n, lambda o: o.torque),
            "velocity_error": (robot.n, lambda o: o.error),
            "system_status": (1, lambda o: [o.status]),
        }
        declare_readouts(self, self._output, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _evaluate(self, context: Context) -> _Output:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        memory, v_desired, zero = self._remembered(context), np.array(self._command.Eval(context)), 0.0 * terms.g
        if not terms.finite:
            return _Output(memory.gravity, zero, SystemStatus.BRAKES_ON)
        status, before = status_of(v_desired), memory.command
        v_desired = v_desired if status == SystemStatus.OK else zero
        before = v_desired if status != SystemStatus.OK or before is None else before
        a_desired = self._params.feedforward * (v_desired - before) / self._params.period
        a_desired = a_desired + self._params.integral_gain * memory.integral
        torque = servo_torque(terms, v_desired, a_desired, self._params.gain, self._viscous)
        return _Output(torque, v_desired - terms.v, status)

    def _given(self, context: Context) -> bool:
        """Return whether the joints get the torque that is asked for."""
        if not self._applied.HasValue(context):
            return True
        missing = self._applied.Eval(context) - self._output.Eval(context).torque
        return bool(np.all(np.abs(missing) <= self._tolerance))

    def _update(self, context: Context, state: State) -> None:
        terms, command = self._dynamics.Eval(context), np.array(self._command.Eval(context))
        before, p = self._remembered(context), self._params
        known = terms.finite and status_of(command) == SystemStatus.OK
        integral = 0.0 * before.integral
        if known:
            wanted = before.integral + p.period * (command - terms.v)
            integral = np.clip(wanted, -p.integral_limit, p.integral_limit)
            if not self._given(context):
                integral = np.where(np.abs(integral) < np.abs(before.integral), integral, before.integral)
        gravity = terms.g if terms.finite else before.gravity
        memory = _Memory(gravity, integral, command if status_of(command) == SystemStatus.OK else None)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
