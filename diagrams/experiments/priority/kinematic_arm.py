"""An arm that follows velocity commands exactly."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters, quantize
from saphari_drake.simulation.world.profile import Truth
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
    position_measured : n (rad or m), held over each cycle; q ← q + T q̇ at its end. Starts at the home posture. Of a
        plant that is not ideal, read by its encoders, and q̇ is late by its delay.
    """

    def __init__(self, robot: RobotModel, period: float, truth: Truth | None = None) -> None:
        super().__init__()
        self._period, self._n, truth = period, robot.n, truth or Truth()
        self._step = truth.joint_sensor(JointSensorParameters(period, 0.0)).position_resolution
        self._velocity = self.DeclareVectorInputPort("velocity_commanded", BasicVector(robot.n))
        self._position = self.DeclareDiscreteState(robot.home)
        self._late = self.DeclareDiscreteState(truth.profile.torque_delay * robot.n)  # commands, the oldest first
        held = {self.discrete_state_ticket(self._position)}
        self.DeclareVectorOutputPort("position_measured", BasicVector(robot.n), self._calc, prerequisites_of_calc=held)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(quantize(np.array(context.get_discrete_state(self._position).value()), self._step))

    def _update(self, context: Context, state: State) -> None:
        q = context.get_discrete_state(self._position).value()
        commands = np.append(context.get_discrete_state(self._late).value(), self._velocity.Eval(context))
        v = commands[: self._n]
        state.get_mutable_discrete_state(self._late).SetFromVector(commands[self._n :])
        state.get_mutable_discrete_state(self._position).SetFromVector(q + self._period * v)
