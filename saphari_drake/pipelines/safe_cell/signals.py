"""Small systems between the methods of the safe cell: who holds the robot, what is broken, how fast it may go."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import SkinReading
from saphari_drake.parameters import require_choice, require_non_negative, require_positive
from saphari_drake.systems import cycle

LIMITS = ("both", "separation", "force")


@dataclass
class CellSignalParameters:
    """Thresholds between the methods. All assumed."""

    # N; a skin that is pressed harder, or a tool that is pulled harder, is held by somebody.
    skin_force: float = 3.0
    wrist_force: float = 6.0
    # Which monitor leaves speed: "both", the larger of the two: as near as it gets, contacts stay soft; or one alone.
    limit: str = "both"
    # s; from the start on, until all sensors tell something, nothing counts as broken; how long a status lasts until it
    # does.
    settle_time: float = 0.3
    patience: float = 0.01
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        require_positive(self, "skin_force", "wrist_force", "period")
        require_non_negative(self, "settle_time", "patience")
        require_choice(self, "limit", LIMITS)


class HoldDetector(LeafSystem):
    """Tells whether somebody holds skin or tool.

    .. pydrake_system::

        name: HoldDetector
        input_ports:
        - skin
        - wrench_measured
        output_ports:
        - taken

    Ports
    -----
    skin : abstract `SkinReading`; optional: never pressed.
    wrench_measured : 6 (Nm, N), of the person on the tool; optional: never pulled. Not finite: NaN.
    taken : 1, 0 or 1, or NaN.
    """

    def __init__(self, params: CellSignalParameters | None = None) -> None:
        super().__init__()
        self._params = params or CellSignalParameters()
        self._skin = self.DeclareAbstractInputPort("skin", AbstractValue.Make(SkinReading()))
        self._wrench = self.DeclareVectorInputPort("wrench_measured", BasicVector(6))
        tickets = {self._skin.ticket(), self._wrench.ticket()}
        self.DeclareVectorOutputPort("taken", BasicVector(1), self._calc, tickets)

    def _calc(self, context: Context, output: BasicVector) -> None:
        pressed = pulled = 0.0
        if self._skin.HasValue(context):
            reading: SkinReading = self._skin.Eval(context)
            pressed = max((float(np.linalg.norm(contact.f_L)) for contact in reading.contacts), default=0.0)
        if self._wrench.HasValue(context):
            pulled = float(np.linalg.norm(self._wrench.Eval(context)[3:]))
        held = pressed > self._params.skin_force or pulled > self._params.wrist_force
        output.SetAtIndex(0, float(held) if np.isfinite([pressed, pulled]).all() else np.nan)


class FaultGate(LeafSystem):
    """Tells which statuses are broken, as `Supervisor` takes them.

    .. pydrake_system::

        name: FaultGate
        input_ports:
        - (each name of `broken`)
        output_ports:
        - faults

    Ports
    -----
    (each name) : 1, a status.
    faults : 1 a name, 1 where its value is among the broken ones, or not finite, for `patience` (s), else 0.

    Parameters
    ----------
    broken : mapping from str to collection of int
        Values of each status that tell a fault.
    params : CellSignalParameters, optional
    """

    def __init__(self, broken: Mapping[str, Collection[int]], params: CellSignalParameters | None = None) -> None:
        super().__init__()
        self._params, self._broken = params or CellSignalParameters(), [frozenset(values) for values in broken.values()]
        self._ports = [self.DeclareVectorInputPort(name, BasicVector(1)) for name in broken]
        self._lasting = self.DeclareDiscreteState(len(broken))  # s
        self.DeclareVectorOutputPort(
            "faults", BasicVector(len(broken)), self._calc, {self.discrete_state_ticket(self._lasting)}
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)

    def _calc(self, context: Context, output: BasicVector) -> None:
        lasting = context.get_discrete_state(self._lasting).value()
        output.SetFromVector((lasting > self._params.patience).astype(float))

    def _update(self, context: Context, state: State) -> None:
        p, lasting = self._params, np.array(context.get_discrete_state(self._lasting).value())
        values = [float(port.Eval(context)[0]) for port in self._ports]
        bad = [not np.isfinite(value) or int(value) in broken for value, broken in zip(values, self._broken)]
        early = context.get_time() < p.settle_time
        state.get_mutable_discrete_state(self._lasting).SetFromVector(
            np.where(np.array(bad, dtype=bool) & (not early), lasting + p.period, 0.0)
        )


class SpeedChoice(LeafSystem):
    """The share of the speed that both monitors together leave.

    .. pydrake_system::

        name: SpeedChoice
        input_ports:
        - scale_separation
        - scale_force
        output_ports:
        - speed_scale

    Ports
    -----
    scale_separation, scale_force : 1, of `SpeedSeparation` and `PowerForceLimit`.
    speed_scale : 1. Either keeps a person safe: what comes nearer than the protective distance is touched softly.
    """

    def __init__(self, params: CellSignalParameters | None = None) -> None:
        super().__init__()
        self._limit = (params or CellSignalParameters()).limit
        names = ("scale_separation", "scale_force")
        self._ports = [self.DeclareVectorInputPort(name, BasicVector(1)) for name in names]
        self.DeclareVectorOutputPort("speed_scale", BasicVector(1), self._calc, {port.ticket() for port in self._ports})

    def _calc(self, context: Context, output: BasicVector) -> None:
        separation, force = (float(port.Eval(context)[0]) for port in self._ports)
        chosen = {"separation": separation, "force": force}.get(self._limit)
        output.SetAtIndex(0, max(separation, force) if chosen is None else chosen)


class ScaledVelocity(LeafSystem):
    """A joint velocity times a share; zero where one of them is not finite.

    .. pydrake_system::

        name: ScaledVelocity
        input_ports:
        - velocity_commanded
        - speed_limit
        output_ports:
        - velocity_applied

    Ports
    -----
    velocity_commanded, velocity_applied : n (rad/s or m/s).
    speed_limit : 1, clipped to 0 … 1.
    """

    def __init__(self, n: int) -> None:
        super().__init__()
        self._command = self.DeclareVectorInputPort("velocity_commanded", BasicVector(n))
        self._limit = self.DeclareVectorInputPort("speed_limit", BasicVector(1))
        tickets = {self._command.ticket(), self._limit.ticket()}
        self.DeclareVectorOutputPort("velocity_applied", BasicVector(n), self._calc, tickets)

    def _calc(self, context: Context, output: BasicVector) -> None:
        v, share = np.array(self._command.Eval(context)), float(self._limit.Eval(context)[0])
        known = np.isfinite(v).all() and np.isfinite(share)
        output.SetFromVector(min(max(share, 0.0), 1.0) * v if known else 0.0 * np.zeros(len(v)))
