"""What the drives make of a commanded torque: late, noisy, with bias and ripple."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.world.profile import Truth, joint_scale

Array = NDArray[np.float64]


class Actuators(LeafSystem):
    """Stands between the torque that is applied and the plant, at the plant's steps.

    .. pydrake_system::

        name: Actuators
        input_ports:
        - torque_applied
        - state
        output_ports:
        - torque

    Ports
    -----
    torque_applied : n (Nm or N), what the controllers ask for.
    state : 2n (rad or m, then rad/s or m/s), of the plant.
    torque : n (Nm or N), what the joints get: τ(t − d) + noise + bias + ripple · sin(waves · q + phase).

    State: the commands of the last steps, and the noise of the present one, which follows from the seed and the number
    of the step.

    Parameters
    ----------
    robot : RobotModel
    truth : Truth
    step : float
        Step of the plant (s).
    start : (n,) array
        Torque before the first command has arrived (Nm or N).
    """

    def __init__(self, robot: RobotModel, truth: Truth, step: float, start: Array) -> None:
        super().__init__()
        self._n, profile = robot.n, truth.profile
        self._seed, scale = truth.seed, joint_scale(robot)
        self._noise = profile.torque_noise * scale
        self._bias, self._phase = truth.torque_bias(robot), truth.ripple_phase(robot)
        self._ripple, self._waves = profile.torque_ripple * scale, profile.ripple_waves
        self._delay = round(profile.torque_delay * truth.period / step)
        self._command = self.DeclareVectorInputPort("torque_applied", BasicVector(robot.n))
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * robot.n))
        self._commands = self.DeclareDiscreteState(np.tile(start, max(self._delay, 1)))  # the oldest first
        self._drawn = self.DeclareDiscreteState(robot.n + 1)  # noise, and the number of the step
        held = {self.discrete_state_ticket(self._drawn), self.discrete_state_ticket(self._commands)}
        fresh = {self._command.ticket()} if self._delay == 0 else set()
        tickets = held | fresh | {self._state.ticket()}
        self.DeclareVectorOutputPort("torque", BasicVector(robot.n), self._calc, prerequisites_of_calc=tickets)
        # An unrestricted update, as the plant's own: both see the values before the step.
        self.DeclarePeriodicUnrestrictedUpdateEvent(step, 0.0, self._update)

    def _calc(self, context: Context, output: BasicVector) -> None:
        if self._delay == 0:
            torque = self._command.Eval(context)
        else:
            torque = context.get_discrete_state(self._commands).value()[: self._n]
        noise = context.get_discrete_state(self._drawn).value()[: self._n]
        q = self._state.Eval(context)[: self._n]
        ripple = self._ripple * np.sin(self._waves * q + self._phase)
        output.SetFromVector(torque + noise + self._bias + ripple)

    def _update(self, context: Context, state: State) -> None:
        commands = context.get_discrete_state(self._commands).value()
        step = context.get_discrete_state(self._drawn).value()[-1] + 1.0
        noise = self._noise * np.random.Generator(np.random.SFC64([self._seed, int(step)])).standard_normal(self._n)
        later = np.append(commands[self._n :], self._command.Eval(context))
        state.get_mutable_discrete_state(self._commands).SetFromVector(later)
        state.get_mutable_discrete_state(self._drawn).SetFromVector(np.append(noise, step))
