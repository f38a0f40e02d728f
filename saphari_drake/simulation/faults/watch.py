"""How soon a fault is answered: the time at which any system publishes a safe state, and what the joints did."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem, OutputPort, State

from saphari_drake.control.hand_guiding.touch import GuidingStatus
from saphari_drake.control.nmpc.parameters import NmpcStatus
from saphari_drake.control.reverse_priority.law import PriorityStatus
from saphari_drake.messages import InteractionMode, SystemStatus
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus
from saphari_drake.safety.supervisor.law import CellState
from saphari_drake.safety.velocity_envelope.law import VelocityStatus
from saphari_drake.safety.verified_stop.law import StopStatus
from saphari_drake.simulation.faults.signals import SignalFault
from saphari_drake.simulation.faults.wiring import of_kind
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


class Answer(NamedTuple):
    """What became of the faults of a run."""

    time: float  # s, of the first safe state from the fault on; infinite if none was published
    observable: float  # s, since when a fault has an effect above the noise; infinite if it had none
    speed_share: float  # largest speed of a joint from the fault on, over its limit; NaN where it is not known

    @property
    def reaction(self) -> float:
        """Time from effect to answer (s): infinite if it is silent, zero if it came before, or nothing was to tell."""
        if not np.isfinite(self.time):
            return np.inf if np.isfinite(self.observable) else 0.0
        return max(self.time - self.observable, 0.0)


class FaultWatch(LeafSystem):
    """Notes when a safe state is published first after a fault, and what the joints do.

    .. pydrake_system::

        name: FaultWatch
        input_ports:
        - state
        - (each port that is watched)
        - (acts of each signal that is spoiled)
        output_ports:
        - answer

    Ports
    -----
    state : 2n (rad or m, then rad/s or m/s), of the plant; optional.
    (each port that is watched) : 1, a status. One that is safe since the beginning, before the first sensor has told
        anything, answers no fault until it has been otherwise.
    (acts of each signal that is spoiled) : 1, whether its fault has an effect; without such signals all have one.
    answer : 3, an `Answer`.
    """

    def __init__(
        self, ports: list[tuple[str, tuple[int, ...]]], start: float, signals: list[str], v_max: Array
    ) -> None:
        super().__init__()
        self._start, self._safe, self._v_max = start, [values for _, values in ports], v_max
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * len(v_max)))
        self._ports = [self.DeclareVectorInputPort(name, BasicVector(1)) for name, _ in ports]
        self._signals = [self.DeclareVectorInputPort(name, BasicVector(1)) for name in signals]
        self._answer = self.DeclareDiscreteState([np.inf, np.inf, np.nan])
        self._begun = self.DeclareDiscreteState(len(ports))  # 1: the port has told another state than a safe one
        self.DeclareStateOutputPort("answer", self._answer)
        self.DeclarePeriodicUnrestrictedUpdateEvent(STEP, OFFSET, self._look)

    def _look(self, context: Context, state: State) -> None:
        now, begun = context.get_time(), context.get_discrete_state(self._begun).value()
        safe = np.array([port.Eval(context)[0] in values for port, values in zip(self._ports, self._safe)], dtype=bool)
        state.get_mutable_discrete_state(self._begun).SetFromVector(np.where(safe, begun, 1.0))
        if now < self._start:
            return
        time, observable, share = context.get_discrete_state(self._answer).value()
        if np.any(safe & (begun > 0.0)):
            time = min(time, now)
        if not self._signals or any(port.Eval(context)[0] > 0.0 for port in self._signals):
            observable = min(observable, self._start if not self._signals else now)
        if self._state.HasValue(context):
            speed = np.abs(self._state.Eval(context)[len(self._v_max) :])
            share = np.fmax(share, np.max(speed / self._v_max))
        state.get_mutable_discrete_state(self._answer).SetFromVector([time, observable, share])


def watched(builder: DiagramBuilder) -> Iterator[tuple[str, OutputPort, tuple[int, ...]]]:
    """Return name, port and safe values of every status that the systems of a diagram publish."""
    for system in builder.GetSystems():
        kinds = {"", *(kind.__name__ for kind in type(system).__mro__)}
        for index in range(system.num_output_ports()):
            port = system.get_output_port(index)
            for (kind, name), values in SAFE.items():
                if kind in kinds and port.get_name() == name:
                    yield f"{system.get_name()} {name}", port, values


def add_watch(builder: DiagramBuilder, truth: Truth, robot: RobotModel, state: OutputPort | None = None) -> None:
    """Add a watch of all safe states that a diagram publishes, from the first fault on."""
    found, spoiled = list(watched(builder)), list(of_kind(builder, SignalFault))
    signals, ports = [f"{system.get_name()} acts" for system in spoiled], [(name, safe) for name, _, safe in found]
    watch = FaultWatch(ports, min(truth.faults.values()), signals, robot.v_max)
    builder.AddNamedSystem(NAME, watch)
    for name, port, _ in found:
        builder.Connect(port, watch.GetInputPort(name))
    for name, system in zip(signals, spoiled):
        builder.Connect(system.GetOutputPort("acts"), watch.GetInputPort(name))
    if state is not None:
        builder.Connect(state, watch.GetInputPort("state"))


def answer(diagram: Diagram, root: Context) -> Answer | None:
    """Return what became of the faults of a run; None in a diagram without faults."""
    if not diagram.HasSubsystemNamed(NAME):
        return None
    watch = diagram.GetSubsystemByName(NAME)
    return Answer(*watch.get_output_port().Eval(watch.GetMyContextFromRoot(root)).tolist())
