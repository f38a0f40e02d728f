"""Joint positions and velocities as encoders give them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.compiled import njit
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle

Array = NDArray[np.float64]


@dataclass
class JointSensorParameters:
    """What the encoders resolve."""

    # s; sampling period, which is also the control cycle. The deliverable reports 5 ms.
    period: float = 0.005
    # rad or m; size of one encoder step, 0 = exact. Assumed.
    position_resolution: float = 1.0e-5
    # rad/s or m/s; step of the velocity that comes with the state, 0 = exact. Used if not differentiate. Assumed.
    velocity_resolution: float = 0.0
    # Whether velocity is the difference of two position samples (half a period late), as encoders give it.
    differentiate: bool = True

    def __post_init__(self) -> None:
        require_positive(self, "period")
        require_non_negative(self, "position_resolution", "velocity_resolution")


@njit(cache=True)
def quantize(value: Array, resolution: float) -> Array:
    """Round a vector to whole steps of `resolution`; 0 returns the values as they are."""
    return value.copy() if resolution == 0.0 else resolution * np.rint(value / resolution)


@njit(cache=True)
def sampled(state: Array, before: Array, resolution: tuple[float, float], period: float) -> tuple[Array, Array]:
    """Return positions and velocities (n,) of a state (2n,), rounded to steps of `resolution`.

    With a period that is not 0 (s), velocities are the difference to the positions of the sample before.
    """
    n = len(before)
    q = quantize(state[:n], resolution[0])
    return q, (q - before) / period if period > 0.0 else quantize(state[n:], resolution[1])


class JointSensor(LeafSystem):
    """Samples and holds the joint state with encoder resolution.

    .. pydrake_system::

        name: JointSensor
        input_ports:
        - state
        output_ports:
        - position_measured
        - velocity_measured

    Ports
    -----
    state : 2n (rad or m, then rad/s or m/s), from the plant.
    position_measured : n, held over each period.
    velocity_measured : n, held over each period; the difference of the last two positions, or quantized velocity.

    What is downstream of the held samples is a function of them and is evaluated once a period.
    """

    def __init__(self, robot: RobotModel, params: JointSensorParameters | None = None) -> None:
        super().__init__()
        self._n, self._params = robot.n, params or JointSensorParameters()
        self._state = self.DeclareVectorInputPort("state", BasicVector(2 * robot.n))
        self._q = self.DeclareDiscreteState(robot.home)
        self._v = self.DeclareDiscreteState(robot.n)
        period, resolution = self._params.period, (self._params.position_resolution, self._params.velocity_resolution)
        self._rules = resolution, period if self._params.differentiate else 0.0
        sampled(np.zeros(2 * robot.n), robot.home, *self._rules)  # compiled before the first sample
        self.DeclareInitializationUnrestrictedUpdateEvent(self._sample_first)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._sample)
        self.DeclareStateOutputPort("position_measured", self._q)
        self.DeclareStateOutputPort("velocity_measured", self._v)

    def _sample_first(self, context: Context, updated: State) -> None:
        state = self._state.Eval(context)
        self._store(updated, quantize(state[: self._n], self._params.position_resolution), state[self._n :])

    def _sample(self, context: Context, updated: State) -> None:
        state = self._state.Eval(context)
        before = np.array(context.get_discrete_state(self._q).value())
        self._store(updated, *sampled(state, before, *self._rules))

    def _store(self, updated: State, q: Array, v: Array) -> None:
        updated.get_mutable_discrete_state(self._q).SetFromVector(q)
        updated.get_mutable_discrete_state(self._v).SetFromVector(v)


class MotorEncoder(JointSensor):
    """The second encoders of the joints, at the motors: sampled alike, and struck by faults of their own alone.

    .. pydrake_system::

        name: MotorEncoder
        input_ports:
        - state
        output_ports:
        - position_measured
        - velocity_measured

    Ports
    -----
    state : 2n (rad or m, then rad/s or m/s), from the plant.
    position_measured, velocity_measured : n, as of a `JointSensor`.
    """
