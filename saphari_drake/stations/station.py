"""A real robot as a system of a diagram."""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.messages import Immutable
from saphari_drake.robots.model import RobotModel
from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.ports import StationPorts
from saphari_drake.stations.shared import Link, StationStatus
from saphari_drake.systems import CYCLE_OFFSET, cycle, declare_outputs

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Sample(Immutable):
    position: Array
    velocity: Array
    torque_measured: Array
    torque_acting: Array
    torque_external: Array
    status: StationStatus
    counts: Array  # missed, late
    success: float
    time: float = 0.0  # s, of the robot


class RobotStation(LeafSystem):
    """Samples a robot in each cycle, and gives its loop the torque that the diagram makes of the sample.

    .. pydrake_system::

        name: RobotStation
        input_ports:
        - torque_applied
        output_ports:
        - position_measured
        - velocity_measured
        - torque_measured
        - torque_acting
        - torque_external
        - status
        - missed_cycles
        - late_cycles
        - success_rate

    Ports
    -----
    torque_applied : n (Nm or N), what shall drive the joints, weight and all; not finite: the robot is braked.
    position_measured : n (rad or m), held over each period; NaN while the robot is LOST, as all vectors that follow.
    velocity_measured : n (rad/s or m/s).
    torque_measured : n (Nm or N), of sensors at the joints; NaN where the robot has none.
    torque_acting : n (Nm or N), given last, after the envelope of the loop.
    torque_external : n (Nm or N), what others do to the robot, as the loop observes it at the robot's own rate.
    status : 1, a `StationStatus`; LOST too while the loop has not said anything for `stale_time`.
    missed_cycles : 1, cycles on the robot's clock that the loop saw nothing of.
    late_cycles : 1, cycles that began more than half a period late on the computer's clock.
    success_rate : 1 (0–1), of the robot's last cycles, of those that got a command; NaN: not told.

    The command goes out right after the sample it was made of, so that the diagram adds no cycle of delay. Samples are
    of the outer world: a Context that is run again sees another robot. Nothing is limited here, but by the loop.
    """

    def __init__(self, robot: RobotModel, link: Link, params: StationParameters | None = None) -> None:
        super().__init__()
        self._link, self._params, n = link, params or StationParameters(), robot.n
        nan = np.full(n, np.nan)
        self._lost = _Sample(nan, nan, nan, nan, nan, StationStatus.LOST, np.zeros(2), np.nan)
        self._torque = self.DeclareVectorInputPort("torque_applied", BasicVector(n))
        sample = self.DeclareAbstractState(AbstractValue.Make(self._lost))
        reads = {
            "position_measured": lambda s: s.position,
            "velocity_measured": lambda s: s.velocity,
            "torque_measured": lambda s: s.torque_measured,
            "torque_acting": lambda s: s.torque_acting,
            "torque_external": lambda s: s.torque_external,
            "status": lambda s: [float(s.status)],
            "missed_cycles": lambda s: s.counts[:1],
            "late_cycles": lambda s: s.counts[1:],
            "success_rate": lambda s: [s.success],
        }
        self._sample_index = int(sample)

        def held(context: Context) -> _Sample:
            sampled: _Sample = context.get_abstract_state(int(sample)).get_value()
            return sampled

        declare_outputs(self, held, self.abstract_state_ticket(sample), self._lost, reads)
        period = self._params.period
        self.DeclareInitializationUnrestrictedUpdateEvent(self._sample)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._sample)
        # After all updates of the cycle, before its next one.
        self.DeclarePeriodicPublishEvent(period, period + 2.0 * CYCLE_OFFSET, self._command)

    @property
    def ports(self) -> StationPorts:
        """The ports that all stations have."""
        names = StationPorts._fields[1:]
        return StationPorts(self._torque, *(self.GetOutputPort(name) for name in names))

    def _sample(self, context: Context, state: State) -> None:
        state.get_mutable_abstract_state(self._sample_index).set_value(self._read())

    def _read(self) -> _Sample:
        told = self._link.reading.read()
        if told is None or time.monotonic() - told["stamp"][0] > self._params.stale_time:
            return self._lost
        status = StationStatus(int(told["status"][0]))
        counts = np.concatenate((told["missed"], told["late"]))
        if status == StationStatus.LOST or not np.isfinite(told["position"]).all():
            return replace(self._lost, counts=counts)
        return _Sample(
            told["position"],
            told["velocity"],
            told["torque_measured"],
            told["torque_acting"],
            told["torque_external"],
            status,
            counts,
            float(told["success"][0]),
            float(told["time"][0]),
        )

    def _command(self, context: Context) -> EventStatus:
        sample: _Sample = context.get_abstract_state(self._sample_index).get_value()
        torque = self._torque.Eval(context)
        self._link.command.write(torque=torque, time=sample.time)
        return EventStatus.Succeeded()
