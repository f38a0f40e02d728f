"""Joint position, velocity and acceleration behind coarse encoders, from a Kalman filter that knows the model."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import DiscreteAlgebraicRiccatiEquation
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import Immutable, SystemStatus, status_of
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class JointVelocityParameters:
    """What the encoders resolve, and what the model does not know."""

    # rad or m; one step of the encoders. 0: they are fine, and pipelines do without this estimator.
    resolution: float = 0.0
    # Nm (N); torque that the model does not know: hands, friction, errors of the model. Less of it makes commands
    # quieter, more of it shortens the lag behind a push. Assumed; the envelope has one of its own, for it is to see a
    # push before it is quiet.
    unknown_torque: float = 0.1
    envelope_torque: float = 1.0
    # s; time in which that torque may change by its own size: a hand takes hold, a joint turns round. Assumed.
    change_time: float = 0.05
    # s; period with which the joints are sampled.
    period: float = 0.002

    def __post_init__(self) -> None:
        require_non_negative(self, "resolution")
        require_positive(self, "unknown_torque", "envelope_torque", "change_time", "period")


class JointEstimate(NamedTuple):
    """State of all joints, (n,) each."""

    q: Array  # rad or m
    v: Array  # rad/s or m/s
    unmodelled: Array  # rad/s² or m/s², what accelerates a joint beside the model


def velocity_gains(inertia: Array, params: JointVelocityParameters) -> Array:
    """Return the gains (n, 3) of position, velocity and unmodelled acceleration on the error of the position.

    Those of a stationary Kalman filter: the encoder's error is uniform over a step, the unmodelled acceleration a
    random walk that covers `unknown_torque`/inertia in `change_time`. The cut-off, (walk/noise)^(1/6), grows but with
    the cube root of torque over step: with 0.1 Nm and 16 bits on a turn 60 1/s at 2 kg m², 230 1/s at 0.03 kg m².

    Parameters
    ----------
    inertia : (n,) array
        Diagonal of M (kg m² or kg).
    """
    T, noise = params.period, params.resolution**2 / 12.0
    A = np.array([[1.0, T, 0.5 * T**2], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    C = np.array([[1.0, 0.0, 0.0]])
    walk = np.array(
        [[T**5 / 20.0, T**4 / 8.0, T**3 / 6.0], [T**4 / 8.0, T**3 / 3.0, T**2 / 2.0], [T**3 / 6.0, T**2 / 2.0, T]]
    )
    gains = []
    for mass in inertia:
        size = (params.unknown_torque / mass) ** 2 / params.change_time
        # In units of the encoder's noise, without which the equation is badly scaled.
        P = DiscreteAlgebraicRiccatiEquation(A.T, C.T, size / noise * walk, np.eye(1))
        gains.append(P[:, 0] / (P[0, 0] + 1.0))
    return np.array(gains)


def corrected(before: JointEstimate, position: Array, gains: Array) -> JointEstimate:
    """Return the estimate after a measured position (n,)."""
    error = position - before.q
    return JointEstimate(*(x + gain * error for x, gain in zip(before, gains.T)))


def advanced(now: JointEstimate, modelled: Array, period: float) -> JointEstimate:
    """Return the estimate one period later, in which the model accelerates the joints by `modelled` (n,)."""
    a = modelled + now.unmodelled
    return JointEstimate(now.q + period * (now.v + 0.5 * period * a), now.v + period * a, now.unmodelled)


@dataclass(frozen=True)
class _Memory(Immutable):
    predicted: JointEstimate
    modelled: Array  # (n,) acceleration of the model over the last period
    started: bool


class _Output(NamedTuple):
    estimate: JointEstimate
    acceleration: Array
    status: SystemStatus


class JointVelocity(LeafSystem):
    """Estimates position, velocity and acceleration of joints whose encoders are coarse.

    .. pydrake_system::

        name: JointVelocity
        input_ports:
        - position_measured
        - velocity_measured
        - dynamics
        - torque_applied
        output_ports:
        - position_estimated
        - velocity_estimated
        - acceleration_estimated
        - acceleration_unmodelled
        - system_status

    Ports
    -----
    position_measured : n (rad or m), held over each period.
    velocity_measured : n (rad/s or m/s), the difference of positions, from which the estimate starts.
    dynamics : abstract `DynamicsTerms` of the estimated state.
    torque_applied : n (Nm or N), mean torque at the joints over the period that ends, all delays in it.
    position_estimated : n (rad or m).
    velocity_estimated : n (rad/s or m/s), at the time of the sample: not late where the model explains the motion.
    acceleration_estimated : n (rad/s² or m/s²), over the last period: of the model, and what it does not explain.
    acceleration_unmodelled : n (rad/s² or m/s²), the latter alone.
    system_status : 1, a `SystemStatus`; while it is BAD_INPUT, the other outputs are NaN.

    Law: `corrected` by a sample, `advanced` by M⁻¹(τ − C q̇ − g); `velocity_gains` at the home posture. After a state
    or torque that was not finite it starts anew. Dynamics and torque are looked at when a period ends.
    """

    def __init__(self, robot: RobotModel, params: JointVelocityParameters) -> None:
        super().__init__()
        require_positive(params, "resolution")
        n, self._period = robot.n, params.period
        terms = evaluate_dynamics(robot, robot.home, np.zeros(n))
        self.gains = velocity_gains(np.diag(terms.M), params)
        self._position = self.DeclareVectorInputPort("position_measured", BasicVector(n))
        self._velocity = self.DeclareVectorInputPort("velocity_measured", BasicVector(n))
        self._dynamics = DynamicsInput(self, terms)
        self._torque = self.DeclareVectorInputPort("torque_applied", BasicVector(n))
        zero = np.zeros(n)
        self._none = _Memory(JointEstimate(zero, zero, zero), zero, False)
        self._memory = self.DeclareAbstractState(AbstractValue.Make(self._none))
        tickets = {self._position.ticket(), self._velocity.ticket(), self.abstract_state_ticket(self._memory)}
        start = _Output(self._none.predicted, zero, SystemStatus.OK)
        self._output = declare_cache(self, "estimate", start, self._evaluate, tickets)
        readouts = {
            "position_estimated": (n, lambda o: o.estimate.q),
            "velocity_estimated": (n, lambda o: o.estimate.v),
            "acceleration_estimated": (n, lambda o: o.acceleration),
            "acceleration_unmodelled": (n, lambda o: o.estimate.unmodelled),
            "system_status": (1, lambda o: [float(o.status)]),
        }
        declare_readouts(self, self._output, readouts)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)

    def _evaluate(self, context: Context) -> _Output:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        q, v = np.array(self._position.Eval(context)), np.array(self._velocity.Eval(context))
        status = status_of(q, v)
        if status != SystemStatus.OK:
            nan = np.full(len(q), np.nan)
            return _Output(JointEstimate(nan, nan, nan), nan, status)
        now = corrected(memory.predicted, q, self.gains) if memory.started else JointEstimate(q, v, np.zeros(len(q)))
        return _Output(now, memory.modelled + now.unmodelled, status)

    def _update(self, context: Context, state: State) -> None:
        now: _Output = self._output.Eval(context)
        terms: DynamicsTerms = self._dynamics.Eval(context)
        torque, following = np.array(self._torque.Eval(context)), self._none
        if now.status == status_of(torque) == SystemStatus.OK and terms.finite:
            modelled = np.asarray(np.linalg.solve(terms.M, torque - terms.Cv - terms.g), dtype=np.float64)
            following = _Memory(advanced(now.estimate, modelled, self._period), modelled, True)
        state.get_mutable_abstract_state(int(self._memory)).set_value(following)
