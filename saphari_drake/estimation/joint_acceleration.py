"""Joint acceleration as the difference of two velocities."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.parameters import require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle


class JointAcceleration(LeafSystem):
    """Differentiates the measured joint velocity.

    .. pydrake_system::

        name: JointAcceleration
        input_ports:
        - velocity_measured
        output_ports:
        - acceleration_measured

    Ports
    -----
    velocity_measured : n (rad/s or m/s), held over each period.
    acceleration_measured : n (rad/s² or m/s²), mean over the last period (over two, if velocity is a difference of
        positions). Its noise is that of the velocity over the period: fit for the inertia of a tool, not for control.

    State: the velocity of the cycle before.
    """

    def __init__(self, robot: RobotModel, period: float) -> None:
        super().__init__()
        self.period = period
        require_positive(self, "period")
        self._velocity = self.DeclareVectorInputPort("velocity_measured", BasicVector(robot.n))
        self._before = self.DeclareDiscreteState(robot.n)
        tickets = {self._velocity.ticket(), self.discrete_state_ticket(self._before)}
        self.DeclareVectorOutputPort("acceleration_measured", BasicVector(robot.n), self._calc, tickets)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _calc(self, context: Context, output: BasicVector) -> None:
        before = context.get_discrete_state(self._before).value()
        output.SetFromVector((self._velocity.Eval(context) - before) / self.period)

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_discrete_state(self._before).SetFromVector(self._velocity.Eval(context))
