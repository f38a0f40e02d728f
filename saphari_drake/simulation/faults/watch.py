"""How soon a fault is answered: the time at which any system publishes a safe state."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem, OutputPort, State

from saphari_drake.control.hand_guiding.touch import GuidingStatus
from saphari_drake.control.nmpc.parameters import NmpcStatus
from saphari_drake.control.reverse_priority.law import PriorityStatus
from saphari_drake.messages import InteractionMode, SystemStatus
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus
from saphari_drake.safety.supervisor.law import CellState
from saphari_drake.safety.velocity_envelope.law import VelocityStatus
from saphari_drake.safety.verified_stop.law import StopStatus
from saphari_drake.simulation.world.profile import Truth

Array = NDArray[np.float64]
NAME, STEP, OFFSET = "fault_watch", 0.001, 2.0e-6  # s; after the cycles of the same time
# Values of a port, by class and name, in which the robot is in a safe state, or has said that it cannot work.
SAFE: dict[tuple[str, str], tuple[int, ...]] = {
    ("", "system_status"): (SystemStatus.BAD_INPUT, SystemStatus.HOLDING, SystemStatus.BRAKES_ON),
    ("ContactMonitor", "mode"): (InteractionMode.STOP,),
    ("HandGuidingController", "status"): (GuidingStatus.SENSOR_LOST, GuidingStatus.WAITING),
    ("NmpcController", "status"): (
        NmpcStatus.BRAKING, NmpcStatus.START_INSIDE, NmpcStatus.BAD_INPUT, NmpcStatus.OBSTACLES_LOST,
        NmpcStatus.UNSOLVED,
    ),
    ("ReversePriorityController", "status"): (PriorityStatus.INFEASIBLE, PriorityStatus.INVALID),
    ("VelocityEnvelope", "status"): (VelocityStatus.BRAKING, VelocityStatus.BAD_INPUT),
    ("VerifiedStop", "status"): (
        StopStatus.STOPPING, StopStatus.BAD_INPUT, StopStatus.STALE, StopStatus.OBSTACLES_LOST,
    ),
    ("JointEnvelope", "status"): (EnvelopeStatus.BRAKING, EnvelopeStatus.BAD_INPUT),
    ("Supervisor", "state"): (CellState.FAULT,),
}  # fmt: skip


class FaultWatch(LeafSystem):
    """Notes when a safe state is published first after a fault.

    .. pydrake_system::

        name: FaultWatch
        input_ports:
        - (each port that is watched)
        output_ports:
        - answered

    Ports
    -----
    (each port that is watched) : 1, a status. One that is safe since the beginning, before the first sensor has told
        anything, answers no fault until it has been otherwise.
    answered : 1 (s), the time of the first safe state from `start` on; infinite before.
    """

    def __init__(self, ports: list[tuple[str, tuple[int, ...]]], start: float) -> None:
        super().__init__()
        self._start, self._safe = start, [values for _, values in ports]
        self._ports = [self.DeclareVectorInputPort(name, BasicVector(1)) for name, _ in ports]
        self._answered = self.DeclareDiscreteState([np.inf])
        self._begun = self.DeclareDiscreteState(len(ports))  # 1: the port has told another state than a safe one
        self.DeclareStateOutputPort("answered", self._answered)
        self.DeclarePeriodicUnrestrictedUpdateEvent(STEP, OFFSET, self._look)

    def _look(self, context: Context, state: State) -> None:
        now, begun = context.get_time(), context.get_discrete_state(self._begun).value()
        safe = np.array([port.Eval(context)[0] in values for port, values in zip(self._ports, self._safe)], dtype=bool)
        state.get_mutable_discrete_state(self._begun).SetFromVector(np.where(safe, begun, 1.0))
        if now >= self._start and np.any(safe & (begun > 0.0)):
            first = min(now, context.get_discrete_state(self._answered).value()[0])
            state.get_mutable_discrete_state(self._answered).SetFromVector([first])


def watched(builder: DiagramBuilder) -> Iterator[tuple[str, OutputPort, tuple[int, ...]]]:
    """Return name, port and safe values of every status that the systems of a diagram publish."""
    for system in builder.GetSystems():
        kinds = {"", *(kind.__name__ for kind in type(system).__mro__)}
        for index in range(system.num_output_ports()):
            port = system.get_output_port(index)
            for (kind, name), values in SAFE.items():
                if kind in kinds and port.get_name() == name:
                    yield f"{system.get_name()} {name}", port, values


def add_watch(builder: DiagramBuilder, truth: Truth) -> None:
    """Add a watch of all safe states that a diagram publishes, from the first fault on."""
    found = list(watched(builder))
    watch = FaultWatch([(name, values) for name, _, values in found], min(truth.faults.values()))
    builder.AddNamedSystem(NAME, watch)
    for name, port, _ in found:
        builder.Connect(port, watch.GetInputPort(name))


def answered(diagram: Diagram, root: Context) -> float | None:
    """Return when the faults of a run were answered (s), infinite if never; None in a diagram without faults."""
    if not diagram.HasSubsystemNamed(NAME):
        return None
    watch = diagram.GetSubsystemByName(NAME)
    return float(watch.get_output_port().Eval(watch.GetMyContextFromRoot(root))[0])
