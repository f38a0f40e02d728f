"""Desired motion of a frame: there and back along a straight line, smooth in acceleration."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.math.curves import quintic
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.systems import cycle

Array = NDArray[np.float64]


@dataclass
class StraightMotionParameters:
    """Line and timing. All A."""

    # m; to the far end, in the world.
    displacement: list[float] = field(default_factory=lambda: [0.0, 0.2, 0.0])
    # s; first departure, time of one way, and pause at each end.
    start: float = 0.5
    travel_time: float = 3.0
    pause: float = 1.0
    # s; period with which the motion is sampled: that of the controller which follows it.
    period: float = 0.002

    def __post_init__(self) -> None:
        if np.shape(self.displacement) != (3,):
            raise ParameterError("displacement", f"needs three entries, got {self.displacement}")
        require_positive(self, "travel_time", "period")
        require_non_negative(self, "start", "pause")


def straight_motion(params: StraightMotionParameters, time: float) -> tuple[float, float, float]:
    """Return the share of the way (0 to 1), its rate (1/s) and its second derivative (1/s²) at a time (s)."""
    leg = params.travel_time + params.pause
    index, since = divmod(time - params.start, leg)
    if time < params.start:
        return 0.0, 0.0, 0.0
    T = params.travel_time
    s, rate, second = (derivative / T**k for k, derivative in enumerate(quintic(since / T)))
    return (s, rate, second) if index % 2 == 0 else (1.0 - s, -rate, -second)


class StraightMotion(LeafSystem):
    """Desired pose, velocity and acceleration along a straight line, with constant orientation, held over each period.

    .. pydrake_system::

        name: StraightMotion
        output_ports:
        - desired_pose
        - desired_velocity
        - desired_acceleration

    - `desired_pose`: abstract `RigidTransform` in the world.
    - `desired_velocity`, `desired_acceleration`: 6, [ω; v] in the world (rad/s, m/s) and its derivative.
    """

    def __init__(self, start: RigidTransform, params: StraightMotionParameters) -> None:
        super().__init__()
        self._start, self._params, self._way = start, params, np.asarray(params.displacement)
        self._sampled = self.DeclareDiscreteState(3)  # share of the way, its rate and second derivative
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._sample)
        held = {self.discrete_state_ticket(self._sampled)}
        alloc = lambda: AbstractValue.Make(RigidTransform())  # noqa: E731
        self.DeclareAbstractOutputPort("desired_pose", alloc, self._pose, held)
        for order, name in ((1, "desired_velocity"), (2, "desired_acceleration")):
            self.DeclareVectorOutputPort(
                name, BasicVector(6), lambda context, output, k=order: self._rate(context, output, k), held
            )

    def _sample(self, context: Context, state: State) -> None:
        values = straight_motion(self._params, context.get_time())
        state.get_mutable_discrete_state(self._sampled).SetFromVector(values)

    def _pose(self, context: Context, output: AbstractValue) -> None:
        share = context.get_discrete_state(self._sampled).value()[0]
        output.set_value(RigidTransform(self._start.rotation(), self._start.translation() + share * self._way))

    def _rate(self, context: Context, output: BasicVector, order: int) -> None:
        value = context.get_discrete_state(self._sampled).value()[order]
        output.SetFromVector(np.concatenate([np.zeros(3), value * self._way]))
