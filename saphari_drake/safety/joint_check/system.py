"""Stands behind the encoders: passes on what can be true."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem, State

from saphari_drake.messages import Immutable, SystemStatus
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_check.law import JointCheckStatus, Joints, Verdict, judged, remembered, unknown
from saphari_drake.safety.joint_check.parameters import JointCheckParameters, tolerances
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Memory(Immutable):
    joints: Joints
    left: int = 0  # periods until what is consistent is believed
    joint: int = -1


class JointCheck(LeafSystem):
    """Passes positions and velocities on while encoders and drives do not contradict each other; else NaN.

    .. pydrake_system::

        name: JointCheck
        input_ports:
        - position_measured
        - velocity_measured
        - position_second
        - torque_measured
        - torque_expected
        output_ports:
        - status
        - joint
        - system_status
        - position_checked
        - velocity_checked

    Ports
    -----
    position_measured, velocity_measured : n (rad or m) and n (rad/s or m/s), from a joint sensor with this period.
    position_second : n (rad or m), of other encoders of the same joints, such as those of the motors; optional: none.
    torque_measured : n (Nm or N), of the joints' torque sensors; optional: none.
    torque_expected : n (Nm or N), what the drives are to give now; optional: none. No output depends on the torques.
    position_checked, velocity_checked : n, the same as measured; all NaN while a joint is not believed.
    status : 1, a `JointCheckStatus`.
    joint : 1, index of the joint that is not believed, −1 for none.
    system_status : 1, a `SystemStatus`: BRAKES_ON while a joint is not believed, for nothing that is fed back would
        move it rightly; BAD_INPUT while a position is not finite.

    Torques are sampled in the middle of the period: where it begins, one of two faster systems may have gone on already
    and the other one not. That is a discrete update, which lets the outputs be, and all that is evaluated from them.
    Law: `judged`. NaN is what all that follows has a safe answer to. A joint is believed again when all has been
    consistent for `recovery_time`. What it cannot see: an encoder that stops while its joint stands, until the joint
    has moved by the tolerance, and without a second encoder not even then; a drive that errs by less than its
    tolerance; both encoders failing alike. An optional value that is not finite counts as none.
    """

    def __init__(self, robot: RobotModel, params: JointCheckParameters | None = None) -> None:
        super().__init__()
        params, n = params or JointCheckParameters(), robot.n
        self._limits, self._nan = tolerances(robot, params), np.full(n, np.nan)
        names = ("position_measured", "velocity_measured", "position_second", "torque_measured", "torque_expected")
        ports = [self.DeclareVectorInputPort(name, BasicVector(n)) for name in names]
        self._position, self._velocity, self._second, self._measured, self._expected = ports
        memory = _Memory(unknown(n))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(memory))
        self._torques = self.DeclareDiscreteState(np.tile(self._nan, 2))  # expected, then measured
        state = self.abstract_state_ticket(self._memory)
        judged(self._limits, memory.joints, robot.home, self._nan)  # compiles
        remembered(self._limits, memory.joints, robot.home, self._nan, self._nan)
        seen = {self._position.ticket(), self._second.ticket(), state}
        self._verdict = declare_cache(self, "verdict", Verdict(0, -1), self._judge, seen)
        readouts = {
            "status": (1, lambda verdict: [float(verdict.status)]),
            "joint": (1, lambda verdict: [float(verdict.joint)]),
        }
        declare_readouts(self, self._verdict, readouts)
        asked = {self._verdict.ticket(), self._position.ticket()}
        status = declare_cache(self, "system", SystemStatus.OK, self._system_status, asked)
        declare_readouts(self, status, {"system_status": (1, lambda status: [float(status)])})
        for name, port in (("position_checked", self._position), ("velocity_checked", self._velocity)):
            self.DeclareVectorOutputPort(
                name,
                BasicVector(n),
                lambda context, output, port=port: output.SetFromVector(self._believed(context, port)),
                prerequisites_of_calc={self._verdict.ticket(), port.ticket()},
            )
        period, begin = cycle(params.period).values()
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, begin, self._update)
        self.DeclarePeriodicDiscreteUpdateEvent(period, begin - 0.5 * period, self._sample)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _given(self, context: Context, port: InputPort) -> Array:
        return port.Eval(context) if port.HasValue(context) else self._nan

    def _judge(self, context: Context) -> Verdict:
        memory = self._remembered(context)
        second = self._given(context, self._second)
        now = Verdict(*judged(self._limits, memory.joints, self._position.Eval(context), second))
        if now.status == JointCheckStatus.OK and memory.left > 0:
            return Verdict(int(JointCheckStatus.RECOVERING), memory.joint)
        return now

    def _system_status(self, context: Context) -> SystemStatus:
        if self._verdict.Eval(context).status != JointCheckStatus.OK:
            return SystemStatus.BRAKES_ON
        known = np.isfinite(self._position.Eval(context)).all()
        return SystemStatus.OK if known else SystemStatus.BAD_INPUT

    def _believed(self, context: Context, port: InputPort) -> Array:
        believed = self._verdict.Eval(context).status == JointCheckStatus.OK
        return port.Eval(context) if believed else self._nan

    def _update(self, context: Context, state: State) -> None:
        memory, verdict = self._remembered(context), self._verdict.Eval(context)
        torques = np.array(context.get_discrete_state(self._torques).value()).reshape(2, -1)
        joints = Joints(*remembered(self._limits, memory.joints, self._position.Eval(context), *torques))
        left = max(memory.left - 1, 0)
        if verdict.status not in (JointCheckStatus.OK, JointCheckStatus.RECOVERING):
            left = self._limits.recovery
        following = _Memory(joints, left, verdict.joint)
        state.get_mutable_abstract_state(int(self._memory)).set_value(following)

    def _sample(self, context: Context, values: DiscreteValues) -> None:
        torques = [self._given(context, port) for port in (self._expected, self._measured)]
        values.set_value(self._torques, np.concatenate(torques))
