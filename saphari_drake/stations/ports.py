"""The ports of a station, by the same names whatever is behind them."""

from __future__ import annotations

from typing import NamedTuple

from pydrake.systems.framework import InputPort, OutputPort


class StationPorts(NamedTuple):
    """Ports of one robot, real or simulated; n joints.

    Attributes
    ----------
    torque_applied : InputPort
        n (Nm or N), what shall drive the joints, weight and all.
    position_measured, velocity_measured : OutputPort
        n (rad or m) and n (rad/s or m/s), held over each period.
    torque_measured : OutputPort
        n (Nm or N), of sensors at the joints; NaN where the robot has none.
    torque_acting : OutputPort
        n (Nm or N), given last, after the envelope.
    status : OutputPort
        1, a `StationStatus`.
    missed_cycles : OutputPort
        1, of the robot's cycles since the start that got no command in time.
    """

    torque_applied: InputPort
    position_measured: OutputPort
    velocity_measured: OutputPort
    torque_measured: OutputPort
    torque_acting: OutputPort
    status: OutputPort
    missed_cycles: OutputPort
