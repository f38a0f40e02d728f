"""The joint envelope as the last system before the torque."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import Immutable, SystemStatus
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus, Limited, Motion, limited_torque, predicted
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters, envelope_of
from saphari_drake.safety.joint_envelope.stale import Repeated
from saphari_drake.safety.posture_laws import posture_torque
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Memory(Immutable):
    torques: Array  # (k, n), of the last periods, the latest last
    repeated: Repeated


class _Output(NamedTuple):
    limited: Limited
    excess: Array
    system_status: SystemStatus


class JointEnvelope(LeafSystem):
    """Passes a torque on, or the nearest one that keeps torque, its rate, speed, position and energy within limits.

    .. pydrake_system::

        name: JointEnvelope
        input_ports:
        - dynamics
        - torque_external
        - torque_commanded
        output_ports:
        - torque_applied
        - torque_excess
        - status
        - joint
        - margin
        - system_status
        - torque_mean
        - torque_acting

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of a state that is measured in each period of this system.
    torque_external : n (Nm or N), what the environment does to the robot, from `MomentumObserver`; optional: none.
    torque_commanded : n (Nm or N).
    torque_applied : n (Nm or N), what drives the joints.
    torque_excess : n (Nm or N), commanded minus applied.
    status : 1, an `EnvelopeStatus`.
    joint : 1, index of the joint whose limit is the most urgent, −1 for none.
    margin : 1, share of the envelope left: 1 in its middle, 0 at a limit, negative outside.
    system_status : 1, a `SystemStatus`: HOLDING while the command is not finite, or comes from a dead controller
        (`Repeated`): the posture is held where that began; BAD_INPUT while the state is not known: nothing but torque
        and rate can be limited.
    torque_mean : n (Nm or N), mean of the torque at the joints over `mean_time`, with the period that begins now as
        the last; what slower observers are fed. `torque_delay` is in it.
    torque_acting : n (Nm or N), the torque at the joints over the period that begins now, `torque_delay` in it.

    Law and guarantee: `limited_torque`. It knows nothing of the controller inside. An external torque that is not
    finite counts as none. At the start the torque before was that of the weight.
    """

    def __init__(self, robot: RobotModel, params: JointEnvelopeParameters | None = None) -> None:
        super().__init__()
        self._params = params = params or JointEnvelopeParameters()
        self.envelope = envelope_of(robot, params)
        hold = params.hold_stiffness, params.hold_damping
        self._hold = tuple(np.full(robot.n, gain) for gain in hold)
        self._delay, self._width = params.periods("torque_delay"), params.periods("mean_time")
        n = robot.n
        terms, zero = evaluate_dynamics(robot, robot.home, np.zeros(n)), np.zeros(n)
        memory = self._resting(terms)
        self._limited(terms, zero, terms.g, memory.torques)  # compiles
        self._dynamics = DynamicsInput(self, terms)
        self._external = self.DeclareVectorInputPort("torque_external", BasicVector(n))
        self._command = self.DeclareVectorInputPort("torque_commanded", BasicVector(n))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(memory))
        state = self.abstract_state_ticket(self._memory)
        start = _Output(Limited(terms.g, EnvelopeStatus.FREE, -1, 1.0), zero, SystemStatus.OK)
        tickets = {self._dynamics.ticket(), self._external.ticket(), self._command.ticket(), state}
        self._output = declare_cache(self, "limited", start, self._evaluate, tickets)
        readouts = {
            "torque_applied": (n, lambda o: o.limited.torque),
            "torque_excess": (n, lambda o: o.excess),
            "status": (1, lambda o: [float(o.limited.status)]),
            "joint": (1, lambda o: [float(o.limited.joint)]),
            "margin": (1, lambda o: [o.limited.margin]),
            "system_status": (1, lambda o: [float(o.system_status)]),
        }
        declare_readouts(self, self._output, readouts)
        mean = declare_cache(self, "mean", zero, self._mean, {self._output.ticket(), state})
        declare_readouts(self, mean, {"torque_mean": (n, lambda torque: torque)})
        acting = declare_cache(self, "acting", zero, self._acting, {self._output.ticket(), state})
        declare_readouts(self, acting, {"torque_acting": (n, lambda torque: torque)})
        self.DeclareInitializationUnrestrictedUpdateEvent(self._start)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)

    def _resting(self, terms: DynamicsTerms) -> _Memory:
        weight = np.clip(terms.g, -self.envelope.tau_max, self.envelope.tau_max)
        return _Memory(np.tile(weight, (self._delay + max(self._width, 1), 1)), Repeated(weight, terms.q))

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _mean(self, context: Context) -> Array:
        return self._with_now(context)[: self._width].mean(axis=0)

    def _acting(self, context: Context) -> Array:
        return self._with_now(context)[-1 - self._delay]

    def _with_now(self, context: Context) -> Array:
        return np.vstack((self._remembered(context).torques[1:], self._output.Eval(context).limited.torque))

    def _limited(self, terms: DynamicsTerms, external: Array, command: Array, torques: Array) -> Limited:
        motion = Motion(terms.q, terms.v, terms.M, terms.Cv + terms.g, external, torques[-1])
        motion = predicted(self.envelope, motion, torques, self._delay, self._params.velocity_age)
        return Limited(*limited_torque(self.envelope, motion, command))

    def _evaluate(self, context: Context) -> _Output:
        memory, terms = self._remembered(context), self._dynamics.Eval(context)
        torques, repeated = memory.torques, memory.repeated
        given, largest = self._command.Eval(context), 1e3 * self.envelope.tau_max
        known = bool(np.isfinite(given).all())
        command = np.clip(given, -largest, largest) if known else torques[-1]
        if not terms.finite:
            torque = self._within_rate(command, torques[-1])
            return _Output(
                Limited(torque, EnvelopeStatus.BAD_INPUT, -1, np.nan), command - torque, SystemStatus.BAD_INPUT
            )
        external = np.zeros(len(command))
        if self._external.HasValue(context):
            external = np.nan_to_num(self._external.Eval(context), nan=0.0, posinf=0.0, neginf=0.0)
        q_hold = repeated.q_hold if np.array_equal(given, repeated.command, equal_nan=True) else None
        if q_hold is None and not known:
            q_hold = terms.q
        if q_hold is not None:
            command = posture_torque(terms, q_hold, *self._hold)
        now = self._limited(terms, external, command, torques)
        if q_hold is None:
            return _Output(now, command - now.torque, SystemStatus.OK)
        return _Output(now._replace(status=EnvelopeStatus.BAD_INPUT), command - now.torque, SystemStatus.HOLDING)

    def _within_rate(self, command: Array, before: Array) -> Array:
        step = self.envelope.tau_rate * self.envelope.period
        return np.clip(np.clip(command, before - step, before + step), -self.envelope.tau_max, self.envelope.tau_max)

    def _start(self, context: Context, state: State) -> None:
        terms: DynamicsTerms = self._dynamics.Eval(context)
        if terms.finite:
            state.get_mutable_abstract_state(int(self._memory)).set_value(self._resting(terms))

    def _update(self, context: Context, state: State) -> None:
        repeated, terms = self._remembered(context).repeated, self._dynamics.Eval(context)
        repeated = repeated.after(
            self._command.Eval(context), terms.q, terms.v, self._params.period, self._params.stale_time
        )
        state.get_mutable_abstract_state(int(self._memory)).set_value(_Memory(self._with_now(context), repeated))
