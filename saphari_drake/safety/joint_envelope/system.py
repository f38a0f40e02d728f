"""The joint envelope as the last system before the torque."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.math.products import all_finite
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters, envelope_of
from saphari_drake.safety.joint_envelope.stale import Repeated
from saphari_drake.safety.joint_envelope.step import Rules, Step, remembered, stepped
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


class JointEnvelope(LeafSystem):
    """Passes a torque on, or the nearest one that keeps torque, its rate, speed, position and energy within limits.

    .. pydrake_system::

        name: JointEnvelope
        input_ports:
        - position_measured
        - velocity_measured
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
    position_measured : n (rad or m), measured in each period of this system.
    velocity_measured : n (rad/s or m/s), the same.
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

    Law and guarantee: `limited_torque`; all of a period is compiled in `stepped`. It knows nothing of the controller
    inside. An external torque that is not finite counts as none. At the start the torque before was that of the weight.
    """

    def __init__(self, robot: RobotModel, params: JointEnvelopeParameters | None = None) -> None:
        super().__init__()
        params = params or JointEnvelopeParameters()
        self._robot, self.envelope, n = robot, envelope_of(robot, params), robot.n
        delay, width = params.periods("torque_delay"), params.periods("mean_time")
        self._kept, self._none = delay + max(width, 1), np.zeros(n)
        self._rules = Rules(
            self.envelope, params.hold_stiffness, params.hold_damping, delay, width, params.velocity_age,
            params.stale_time,
        )  # fmt: skip
        names = "position_measured", "velocity_measured", "torque_external", "torque_commanded"
        q, v, self._external, command = (self.DeclareVectorInputPort(name, BasicVector(n)) for name in names)
        self._needed = q, v, command
        memory = self._resting(robot.home)
        self._memory = self.DeclareDiscreteState(memory)
        start = stepped(robot.tree, self._rules, memory, robot.home, self._none, self._none, self._none)  # compiles
        self._step = declare_cache(
            self, "step", start, self._evaluate,
            {self.all_input_ports_ticket(), self.discrete_state_ticket(self._memory)},
        )  # fmt: skip
        readouts = {
            "torque_applied": (n, lambda step: step.torques[0]),
            "torque_excess": (n, lambda step: step.torques[1]),
            "status": (1, lambda step: step.numbers[:1]),
            "joint": (1, lambda step: step.numbers[1:2]),
            "margin": (1, lambda step: step.numbers[2:3]),
            "system_status": (1, lambda step: step.numbers[3:]),
            "torque_mean": (n, lambda step: step.torques[2]),
            "torque_acting": (n, lambda step: step.torques[3]),
        }
        declare_readouts(self, self._step, readouts)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._start)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)

    def _resting(self, q: Array) -> Array:
        """Return the memory of an arm that rests at q (n,) under its weight."""
        n, envelope = len(q), self.envelope
        weight = np.clip(evaluate_dynamics(self._robot, q, np.zeros(n)).g, -envelope.tau_max, envelope.tau_max)
        unknown = Repeated(weight, np.full(2 * n, np.nan), 0.0, np.full(n, np.nan))
        memory: Array = remembered(np.tile(weight, (self._kept, 1)), unknown)
        return memory

    def _evaluate(self, context: Context) -> Step:
        q, v, command = (port.Eval(context) for port in self._needed)
        external = self._external.Eval(context) if self._external.HasValue(context) else self._none
        memory = np.array(context.get_discrete_state(self._memory).value())
        step: Step = stepped(self._robot.tree, self._rules, memory, q, v, external, command)
        return step

    def _start(self, context: Context, state: State) -> None:
        q, v, _ = (port.Eval(context) for port in self._needed)
        if all_finite(q) and all_finite(v):
            state.get_mutable_discrete_state(self._memory).SetFromVector(self._resting(q))

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._memory).SetFromVector(self._step.Eval(context).memory)
