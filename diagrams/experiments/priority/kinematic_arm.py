"""An arm that follows velocity commands exactly."""

from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle


class KinematicArm(LeafSystem):
    """Integrates a velocity command, held over each cycle.

    .. pydrake_system::

        name: KinematicArm
        input_ports:
        - velocity_commanded
        output_ports:
        - position_measured

    Ports
    -----
    velocity_commanded : n (rad/s or m/s).
    position_measured : n (rad or m), held over each cycle; q ← q + T q̇ at its end. Starts at the home posture.
    """

    def __init__(self, robot: RobotModel, period: float) -> None:
        super().__init__()
        self._period = period
        self._velocity = self.DeclareVectorInputPort("velocity_commanded", BasicVector(robot.n))
        self._position = self.DeclareDiscreteState(robot.home)
        self.DeclareStateOutputPort("position_measured", self._position)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _update(self, context: Context, state: State) -> None:
        q = context.get_discrete_state(self._position).value()
        v = self._velocity.Eval(context)
        state.get_mutable_discrete_state(self._position).SetFromVector(q + self._period * v)
