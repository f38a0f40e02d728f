"""The velocity envelope as the last system before a velocity interface or a servo."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import Immutable
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.stale import Repeated, after
from saphari_drake.safety.velocity_envelope.law import Course, LimitedVelocity, VelocityStatus, limited_velocity
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters, bounds_of
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Memory(Immutable):
    limited: LimitedVelocity
    excess: Array
    repeated: Repeated


class VelocityEnvelope(LeafSystem):
    """Passes a joint velocity on, or the nearest one that keeps position, speed, acceleration and jerk within limits.

    .. pydrake_system::

        name: VelocityEnvelope
        input_ports:
        - position_measured
        - velocity_commanded
        output_ports:
        - velocity_applied
        - velocity_excess
        - status
        - joint
        - margin

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    velocity_commanded : n (rad/s or m/s).
    velocity_applied : n (rad/s or m/s), to be reached at the end of the period that begins; at the start zero.
    velocity_excess : n (rad/s or m/s), commanded minus applied; zero while the command is not finite.
    status : 1, a `VelocityStatus`.
    joint : 1, index of the joint whose limit is the most urgent, −1 for none.
    margin : 1, share of the envelope left: 1 in its middle, 0 at a limit, negative outside.

    Law and guarantee: `limited_velocity`; what the motors surely give: `bounds_of`. It knows nothing of the controller.
    A command that is not finite, or comes from a dead controller (`Repeated`), counts as zero, so that the joints come
    to rest within their limits; positions that are not finite are taken from the applied velocities meanwhile, and the
    joints come to rest as well. The robot stands at the start.
    """

    def __init__(self, robot: RobotModel, params: VelocityEnvelopeParameters | None = None) -> None:
        super().__init__()
        self._params = params or VelocityEnvelopeParameters()
        self.bounds = bounds_of(robot, self._params)
        n, zero = robot.n, np.zeros(robot.n)
        self._position = self.DeclareVectorInputPort("position_measured", BasicVector(n))
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(n))
        rest = LimitedVelocity(Course(robot.home, zero, zero), int(VelocityStatus.FREE), -1, 1.0)
        limited_velocity(self.bounds, rest.course, robot.home, zero)  # compiles
        nan = np.full(2 * n, np.nan)
        start = _Memory(rest, zero, Repeated(zero, nan, 0.0, nan[:n]))
        after(start.repeated, zero, nan, 0.0, np.inf)  # compiles
        self._memory = self.DeclareAbstractState(AbstractValue.Make(start))
        state = {self.abstract_state_ticket(self._memory)}
        output = declare_cache(self, "limited", start, self._remembered, state)
        readouts = {
            "velocity_applied": (n, lambda o: o.limited.course.v),
            "velocity_excess": (n, lambda o: o.excess),
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

    def _start(self, context: Context, state: State) -> None:
        """Begin at rest where the robot stands."""
        q, memory = np.array(self._position.Eval(context)), self._remembered(context)
        course = memory.limited.course
        course = course._replace(q=np.where(np.isfinite(q), q, course.q))
        memory = replace(memory, limited=memory.limited._replace(course=course))
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)

    def _update(self, context: Context, state: State) -> None:
        memory, q = self._remembered(context), np.array(self._position.Eval(context))
        before, command, p = memory.limited, np.array(self._command.Eval(context)), self._params
        stale_time = p.stale_time if command.any() else np.inf
        repeated = Repeated(*after(memory.repeated, command, np.concatenate((q, q)), p.period, stale_time))
        stale = not np.isnan(repeated.q_hold[0])
        known = np.isfinite(command).all() and np.isfinite(q).all() and not stale
        wish = command if known else np.zeros(len(command))
        course, status, joint, margin = limited_velocity(self.bounds, before.course, q, wish)
        status = status if known else int(VelocityStatus.BAD_INPUT)
        excess = command - course.v if known else np.zeros(len(command))
        memory = _Memory(LimitedVelocity(Course(*course), status, joint, margin), excess, repeated)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
