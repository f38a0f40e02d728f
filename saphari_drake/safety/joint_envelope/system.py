"""The joint envelope as the last system before the torque."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import Immutable
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus, Limited, Motion, limited_torque
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters, envelope_of
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Memory(Immutable):
    limited: Limited
    excess: Array


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

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of a state that is measured as often as this system acts.
    torque_external : n (Nm or N), what the environment does to the robot, from `MomentumObserver`; optional: none.
    torque_commanded : n (Nm or N).
    torque_applied : n (Nm or N), what drives the joints, and what observers are fed; of the cycle before.
    torque_excess : n (Nm or N), commanded minus applied.
    status : 1, an `EnvelopeStatus`.
    joint : 1, index of the joint whose limit is the most urgent, −1 for none.
    margin : 1, share of the envelope left: 1 in its middle, 0 at a limit, negative outside.

    Law and guarantee: `limited_torque`. It knows nothing of the controller inside. While state, external torque or
    command are not known, the torque stays what it was, and the status asks for the brakes.
    """

    def __init__(self, robot: RobotModel, params: JointEnvelopeParameters | None = None) -> None:
        super().__init__()
        self._params = params or JointEnvelopeParameters()
        self.envelope = envelope_of(robot, self._params)
        n = robot.n
        terms, zero = evaluate_dynamics(robot, robot.home, np.zeros(n)), np.zeros(n)
        self._limited(terms, zero, terms.g, terms.g)  # compiles
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._external = self.DeclareVectorInputPort("torque_external", BasicVector(n))
        self._command = self.DeclareVectorInputPort("torque_commanded", BasicVector(n))
        start = _Memory(Limited(terms.g, EnvelopeStatus.FREE, -1, 1.0), zero)
        self._memory = self.DeclareAbstractState(AbstractValue.Make(start))
        state = {self.abstract_state_ticket(self._memory)}
        output = declare_cache(self, "limited", start, self._remembered, state)
        readouts = {
            "torque_applied": (n, lambda o: o.limited.torque),
            "torque_excess": (n, lambda o: o.excess),
            "status": (1, lambda o: [float(o.limited.status)]),
            "joint": (1, lambda o: [float(o.limited.joint)]),
            "margin": (1, lambda o: [o.limited.margin]),
        }
        declare_readouts(self, output, readouts)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._start)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _limited(self, terms: DynamicsTerms, external: Array, command: Array, before: Array) -> Limited:
        motion = Motion(terms.q, terms.v, terms.M, terms.Cv + terms.g, np.array(external), np.array(before))
        return Limited(*limited_torque(self.envelope, motion, np.array(command)))

    def _start(self, context: Context, state: State) -> None:
        """Begin with the weight of the robot where it stands, cut off at the limits."""
        terms: DynamicsTerms = self._dynamics.Eval(context)
        memory = self._remembered(context)
        if terms.finite:
            torque = np.clip(terms.g, -self.envelope.tau_max, self.envelope.tau_max)
            memory = _Memory(memory.limited._replace(torque=torque), memory.excess)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)

    def _update(self, context: Context, state: State) -> None:
        before, terms = self._remembered(context).limited, self._dynamics.Eval(context)
        command = self._command.Eval(context)
        external = self._external.Eval(context) if self._external.HasValue(context) else np.zeros(len(command))
        if terms.finite and np.isfinite(command).all() and np.isfinite(external).all():
            now = self._limited(terms, external, command, before.torque)
            memory = _Memory(now, command - now.torque)
        else:
            memory = _Memory(before._replace(status=EnvelopeStatus.BAD_INPUT), np.zeros(len(command)))
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
