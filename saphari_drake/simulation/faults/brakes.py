"""The holding brakes of a simulated arm, which close while a system asks for them."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, OutputPort, State

from saphari_drake.messages import SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.wiring import insert, readers, source_of
from saphari_drake.simulation.world.cell import Cell

Array = NDArray[np.float64]
CLOSING = 0.02  # s, from the request to closed brakes. Assumed
STICK = 0.9  # share of a joint's momentum that closed brakes take within a step, as far as their torque goes


class HoldingBrakes(LeafSystem):
    """Adds the torque of closed brakes to that of the drives, at the plant's steps.

    .. pydrake_system::

        name: HoldingBrakes
        input_ports:
        - torque
        - state
        - (each request)
        output_ports:
        - torque

    Ports
    -----
    torque (input) : n (Nm or N), of the drives.
    state : 2n (rad or m, then rad/s or m/s), of the plant.
    (each request) : 1, a `SystemStatus`; BRAKES_ON asks for the brakes.
    torque (output) : n (Nm or N); while closed, what stops the joints is added, up to the largest torque of the motors
        (assumed: brakes hold what motors move). The friction is that of a plant as the robot's model tells.
    """

    def __init__(self, robot: RobotModel, names: list[str], step: float) -> None:
        super().__init__()
        self._robot, self._step = robot, step
        self._torque = self.DeclareVectorInputPort("torque", BasicVector(robot.n))
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * robot.n))
        self._requests = [self.DeclareVectorInputPort(name, BasicVector(1)) for name in names]
        self._asked = self.DeclareDiscreteState(1)  # s, for how long
        self.DeclareVectorOutputPort("torque", BasicVector(robot.n), self._calc, {self.all_sources_ticket()})
        self.DeclarePeriodicUnrestrictedUpdateEvent(step, 0.0, self._update)

    def _calc(self, context: Context, output: BasicVector) -> None:
        torque = np.array(self._torque.Eval(context))
        if context.get_discrete_state(self._asked).value()[0] >= CLOSING:
            state, n = self._state.Eval(context), self._robot.n
            terms = evaluate_dynamics(self._robot, state[:n], state[n:])
            stopping = terms.Cv + terms.g - STICK / self._step * (terms.M @ terms.v)
            torque += np.clip(stopping - torque, -self._robot.tau_max, self._robot.tau_max)
        output.SetFromVector(torque)

    def _update(self, context: Context, state: State) -> None:
        asked = any(port.Eval(context)[0] == SystemStatus.BRAKES_ON for port in self._requests)
        before = context.get_discrete_state(self._asked).value()[0]
        state.get_mutable_discrete_state(self._asked).SetFromVector([before + self._step if asked else 0.0])


def add_brakes(builder: DiagramBuilder, cell: Cell) -> None:
    """Put brakes between drives and plant of a wired diagram, at the request of any of its systems."""
    ports = dict(_requests(builder))
    if not ports:
        return
    brakes = builder.AddNamedSystem("brakes", HoldingBrakes(cell.robot, list(ports), cell.params.time_step))
    driving = cell.torque_driving
    source = source_of(builder, cell.torque_input) if driving is None else driving
    target = cell.torque_input
    if driving is not None:
        target = next(port for port in readers(builder, driving) if port.get_system() is not brakes)
    insert(builder, source, target, brakes, ("torque", "torque"))
    builder.Connect(cell.robot_state, brakes.GetInputPort("state"))
    for name, port in ports.items():
        builder.Connect(port, brakes.GetInputPort(name))


def _requests(builder: DiagramBuilder):
    for system in builder.GetSystems():
        if system.HasOutputPort("system_status"):
            port: OutputPort = system.GetOutputPort("system_status")
            yield f"{system.get_name()} {port.get_name()}", port
