"""Joint acceleration as the difference of two velocities."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import status_of
from saphari_drake.parameters import require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts


class JointAcceleration(LeafSystem):
    """Differentiates the measured joint velocity.

    .. pydrake_system::

        name: JointAcceleration
        input_ports:
        - velocity_measured
        output_ports:
        - acceleration_measured
        - system_status

    Ports
    -----
    velocity_measured : n (rad/s or m/s), held over each period.
    acceleration_measured : n (rad/s² or m/s²), mean over the last period (over two, if velocity is a difference of
        positions). Its noise is that of the velocity over the period: fit for the inertia of a tool, not for control.
        NaN while one of the two velocities is not finite.
    system_status : 1, a `SystemStatus`.

    State: the velocity of the cycle before.
    """

    def __init__(self, robot: RobotModel, period: float) -> None:
        super().__init__()
        self.period = period
        require_positive(self, "period")
        self._velocity = self.DeclareVectorInputPort("velocity_measured", BasicVector(robot.n))
        self._before = self.DeclareDiscreteState(robot.n)
        tickets = {self._velocity.ticket(), self.discrete_state_ticket(self._before)}
        acceleration = declare_cache(self, "acceleration", np.zeros(robot.n), self._difference, tickets)
        readouts = {"acceleration_measured": (robot.n, lambda a: a), "system_status": (1, lambda a: [status_of(a)])}
        declare_readouts(self, acceleration, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _difference(self, context: Context) -> NDArray[np.float64]:
        now, before = self._velocity.Eval(context), context.get_discrete_state(self._before).value()
        known = np.isfinite(now).all() and np.isfinite(before).all()
        return (now - before) / self.period if known else np.full(len(now), np.nan)

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._before).SetFromVector(self._velocity.Eval(context))
