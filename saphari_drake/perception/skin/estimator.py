"""SkinEstimator: contacts on a skin patch from its voltages, with taring, drift and faults."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.messages import Immutable, SkinReading, SkinStatus
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.skin.calibration import SkinCalibration
from saphari_drake.perception.skin.contacts import SkinContactLaw, SkinContactParameters
from saphari_drake.perception.skin.layout import CELLS, SkinLayout
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class SkinEstimatorParameters:
    """How voltages are judged; assumed."""

    contacts: SkinContactParameters = field(default_factory=SkinContactParameters)
    # s; control cycle, that of the sensor.
    period: float = 0.002
    # Samples averaged for the baseline at the start and after `tare`, ≥ 0. 0: that of the calibration.
    tare_samples: int = 50
    # N; a module that seems to carry more while taring is touched, or broken, and keeps its baseline.
    tare_limit: float = 0.5
    # s; time constant with which the baseline follows drift while nobody touches.
    drift_time: float = 5.0
    # Share of the converter's range at either end in which a cell is broken (below) or saturated (above), 0–0.5.
    range_margin: float = 0.01
    # Samples without any change in all cells after which a module is taken as broken. 0: never.
    frozen_samples: int = 100
    # Least share of modules that must work, 0–1: below it, the skin is lost. With more dead ones, holes as large as a
    # hand's contact are likely.
    least_usable: float = 0.7
    # s; a sample older than this is lost.
    timeout: float = 0.05

    def __post_init__(self) -> None:
        require_positive(self, "period", "tare_limit", "drift_time", "timeout")
        require_non_negative(self, "tare_samples", "range_margin", "frozen_samples", "least_usable")
        if self.range_margin >= 0.5:
            raise ParameterError("range_margin", f"must be below 0.5, got {self.range_margin}")
        if self.least_usable > 1.0:
            raise ParameterError("least_usable", f"must not exceed 1, got {self.least_usable}")


@dataclass(frozen=True)
class SkinMemory(Immutable):
    """What the estimator keeps from sample to sample.

    Attributes
    ----------
    reading : SkinReading
    f_M : (m, 3) array
        Forces of the modules in their own frames (N).
    baseline, last : (m, 4) arrays
        Voltages without load, and those of the last sample (V).
    tare_sum : (m, 4) array
        Sum of the samples while taring (V).
    tare_left : int
        Samples still to be taken; 0: not taring.
    frozen : (m,) int array
        Samples since a module's voltages changed.
    stale : bool
        Whether the last sample is too old.
    """

    reading: SkinReading
    f_M: Array
    baseline: Array
    last: Array
    tare_sum: Array
    tare_left: int
    frozen: NDArray[np.int64]
    stale: bool = False


class SkinLaw:
    """One sample after the other: faults, baseline, contacts and status."""

    def __init__(
        self, layout: SkinLayout, calibration: SkinCalibration, params: SkinEstimatorParameters | None = None
    ) -> None:
        self.params = params or SkinEstimatorParameters()
        self.contacts = SkinContactLaw(layout, calibration, self.params.contacts)
        self._layout, self._calibration = layout, calibration
        low, high = calibration.limits
        margin = self.params.range_margin * (high - low)
        self._low, self._high = low + margin, high - margin
        self._broken = np.zeros(layout.count, dtype=bool)
        self._broken[calibration.dead] = True

    def start(self) -> SkinMemory:
        """Return the memory before the first sample."""
        m = self._layout.count
        nothing = SkinReading(dead=tuple(np.flatnonzero(self._broken).tolist()))
        zero = np.zeros((m, CELLS))
        tare = int(self.params.tare_samples)
        return SkinMemory(
            nothing, np.zeros((m, 3)), self._calibration.offset, zero, zero, tare, np.zeros(m, dtype=np.int64)
        )

    def sample(self, memory: SkinMemory, voltages: Array, stamp: float) -> SkinMemory:
        """Return the memory after a sample of voltages (m, 4), taken at a time `stamp` (s)."""
        params = self.params
        frozen = np.where((voltages != memory.last).any(axis=1), 0, memory.frozen + 1)
        dead = self._broken | ~((voltages > self._low) & (voltages < np.inf)).all(axis=1)
        if params.frozen_samples:
            dead |= frozen >= params.frozen_samples
        usable = ~dead
        names = tuple(np.flatnonzero(dead).tolist())
        kept = replace(memory, last=voltages, frozen=frozen, stale=False)
        if usable.sum() < max(params.least_usable * len(dead), 1.0):
            lost = SkinReading((), SkinStatus.LOST, names, stamp)
            return replace(kept, reading=lost, f_M=np.zeros_like(memory.f_M))
        dv = np.where(usable[:, None], voltages - memory.baseline, 0.0)
        f_M, bells = self.contacts.solve(dv, usable)
        contacts = self.contacts.contacts(bells, memory.reading.contacts)
        saturated = usable & np.any(voltages > self._high, axis=1)
        status = SkinStatus.DEGRADED if names else SkinStatus.OK
        reading = SkinReading(contacts, SkinStatus.SATURATED if np.any(saturated) else status, names, stamp)
        kept = replace(kept, reading=reading, f_M=f_M)
        return self._with_baseline(kept, voltages, f_M, usable)

    def _with_baseline(self, memory: SkinMemory, voltages: Array, f_M: Array, usable: NDArray[np.bool_]) -> SkinMemory:
        """Average while taring; afterwards follow slow drift while nobody touches."""
        params = self.params
        calm = usable & (np.linalg.norm(f_M, axis=1) < params.tare_limit)
        if memory.tare_left > 0:
            total = memory.tare_sum + np.where(usable[:, None], voltages, 0.0)
            if memory.tare_left > 1:
                return replace(memory, tare_sum=total, tare_left=memory.tare_left - 1)
            mean = total / params.tare_samples
            baseline = np.where(calm[:, None], mean, memory.baseline)
            return replace(memory, tare_sum=np.zeros_like(total), tare_left=0, baseline=baseline)
        if memory.reading.contacts:
            return memory
        share = min(params.period / params.drift_time, 1.0)
        change = np.where(calm[:, None], voltages - memory.baseline, 0.0)
        return replace(memory, baseline=memory.baseline + share * change)


class SkinEstimator(LeafSystem):
    """Finds contact points and forces on a skin patch.

    .. pydrake_system::

        name: SkinEstimator
        input_ports:
        - voltages
        - sample_time
        output_ports:
        - skin_reading
        - skin_status
        - module_forces

    Ports
    -----
    voltages : 4m (V), from `SkinSensor`.
    sample_time : 1 (s), when they were read.
    skin_reading : abstract `SkinReading`, of the newest sample: contacts in the link frame, status, dead modules.
    skin_status : 1, its `SkinStatus` as a number.
    module_forces : 3m (N), of each module in its own frame, for figures.

    The reading follows from the held sample and the memory of those before, and is evaluated once a sample.
    Voltages that are not finite belong to dead modules; with too few left, or samples that stop coming, the skin is
    LOST and has no contacts. State: `SkinMemory`.

    Parameters
    ----------
    layout : SkinLayout
    calibration : SkinCalibration
    params : SkinEstimatorParameters, optional
    """

    def __init__(
        self, layout: SkinLayout, calibration: SkinCalibration, params: SkinEstimatorParameters | None = None
    ) -> None:
        super().__init__()
        self.law = SkinLaw(layout, calibration, params)
        self._shape = layout.count, CELLS
        self._voltages = self.DeclareVectorInputPort("voltages", BasicVector(layout.count * CELLS))
        self._time = self.DeclareVectorInputPort("sample_time", BasicVector(1))
        start = self.law.start()
        self._memory = self.DeclareAbstractState(AbstractValue.Make(start))
        tickets = {self._voltages.ticket(), self._time.ticket(), self.abstract_state_ticket(self._memory)}
        self._latest = declare_cache(self, "latest", start, self._evaluate, tickets)
        self.DeclareAbstractOutputPort(
            "skin_reading",
            alloc=lambda: AbstractValue.Make(SkinReading()),
            calc=lambda context, output: output.set_value(self._latest.Eval(context).reading),
            prerequisites_of_calc={self._latest.ticket()},
        )
        readouts = {
            "skin_status": (1, lambda memory: [float(memory.reading.status)]),
            "module_forces": (3 * layout.count, lambda memory: memory.f_M.ravel()),
        }
        declare_readouts(self, self._latest, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self.law.params.period), update=self._update)

    def tare(self, context: Context) -> None:
        """Take a new baseline from the next samples; nobody may touch the skin meanwhile."""
        memory = self._kept(context)
        fresh = replace(memory, tare_left=int(self.law.params.tare_samples), tare_sum=np.zeros_like(memory.tare_sum))
        context.SetAbstractState(int(self._memory), fresh)

    def _kept(self, context: Context) -> SkinMemory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _evaluate(self, context: Context) -> SkinMemory:
        memory, stamp = self._kept(context), float(self._time.Eval(context)[0])
        if stamp == memory.reading.stamp:  # this sample is in the memory already
            return memory
        return self.law.sample(memory, self._voltages.Eval(context).reshape(self._shape), stamp)

    def _update(self, context: Context, state: State) -> EventStatus:
        memory: SkinMemory = self._latest.Eval(context)
        age = context.get_time() - memory.reading.stamp
        if not age <= self.law.params.timeout and memory.reading.status != SkinStatus.LOST:
            lost = replace(memory.reading, contacts=(), status=SkinStatus.LOST)
            memory = replace(memory, reading=lost, f_M=np.zeros_like(memory.f_M), stale=True)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
        return EventStatus.Succeeded()
