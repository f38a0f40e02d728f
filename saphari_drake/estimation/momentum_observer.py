"""Momentum observer: the external joint torque from position, velocity and commanded torque alone."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.joint_friction import JointFrictionParameters, joint_friction
from saphari_drake.math.products import all_finite
from saphari_drake.messages import status_of
from saphari_drake.parameters import diagonal, require_non_negative, require_positive
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class MomentumObserverParameters:
    """Bandwidth of the residual."""

    # 1/s, one for all joints or one a joint; r reaches 63 % of a step in 1/gain. 50 for the deliverable's, assumed.
    gain: list[float] | float = 50.0
    # s; how long after the period in which it is told the torque acts; negative if what is told is older.
    torque_delay: float = 0.0
    # By how many periods the measured velocity is late: 0 for a sample, 0.5 for a difference of two positions.
    velocity_delay: float = 0.0
    # Periods over which the residual is averaged; 1: none. A coarse encoder's noise is that of a second derivative: the
    # average of four leaves a quarter of it for 1.5 periods of lag.
    averaged: int = 1
    # Of the joints, as identified.
    friction: JointFrictionParameters = field(default_factory=JointFrictionParameters)
    # s; the period with which the measured state is sampled.
    period: float = 0.005

    def __post_init__(self) -> None:
        require_positive(self, "gain", "averaged", "period")
        require_non_negative(self, "velocity_delay")
        if not 0.0 <= self.delay < np.inf:
            raise ParameterError("torque_delay", f"with velocity_delay must not be negative, got {self.delay} periods")

    @property
    def delay(self) -> float:
        """By how many periods the torque is ahead of the velocity."""
        return self.torque_delay / self.period + self.velocity_delay

    @property
    def bandwidth(self) -> NDArray[np.float64]:
        """The gain (1/s) of a residual that lags as much without an average."""
        return 1.0 / (1.0 / np.asarray(self.gain, dtype=float) + 0.5 * (self.averaged - 1) * self.period)


def discrete_gain(gain: Array, period: float) -> Array:
    """Return the gain that makes the sampled residual the exact filter r⁺ = e^{−K_I T} r + (1 − e^{−K_I T})(−τ_ext)."""
    return -np.expm1(-gain * period) / period


def residual(momentum: Array, integral: Array, gain: Array) -> Array:
    """Return r = K_I (p − σ), eq. (45) of the deliverable, σ starting at p(0) (printed for p(0) = 0).

    Parameters
    ----------
    momentum, integral : (n,) arrays
        p = M q̇ and σ = p(0) + ∫(τ + Cᵀq̇ − g + r)dt (Nms).
    gain : (n,) array
        K_I (1/s).

    Returns
    -------
    (n,) array
        r ≈ −τ_ext = JᵀF of the forces that act *on* the robot (Nm).
    """
    return gain * (momentum - integral)


def advance_integral(integral: Array, r: Array, torque: Array, terms: DynamicsTerms, period: float) -> Array:
    """Return σ after one period in which torque, dynamics and residual were held (De Luca and Mattone, 2005)."""
    return integral + period * (torque + terms.CTv - terms.g + r)


def delayed(torques: Array, cycles: float) -> Array:
    """Return the mean torque (n,) over a period that ended some cycles ago.

    Parameters
    ----------
    torques : (k, n) array
        Of the last periods, the newest first; what is older than all of them is taken as the oldest.
    cycles : float
        Delay in periods, whole or not.
    """
    whole, last = int(cycles), len(torques) - 1
    share = cycles - whole
    return (1.0 - share) * torques[min(whole, last)] + share * torques[min(whole + 1, last)]


class _Memory(NamedTuple):
    share: Array  # (n,) of the Coulomb friction
    integral: Array  # (n,) σ
    recent: Array  # (k, n) residuals of the average before the latest, the newest first
    past: Array  # (k, n) torques of the last periods, the newest first
    filled: int  # how many of these are known
    started: bool

    def sigma(self, terms: DynamicsTerms) -> Array:
        """Return σ; before the first update p: the residual starts at zero whatever the initial momentum is."""
        return self.integral if self.started else terms.p


class _Estimate(NamedTuple):
    r: Array
    averaged: Array
    unsure: Array  # friction_uncertainty
    rubbing: Array  # friction_torque


class MomentumObserver(LeafSystem):
    """Residual of the generalized momentum, eq. (45).

    .. pydrake_system::

        name: MomentumObserver
        input_ports:
        - dynamics
        - torque_applied
        output_ports:
        - torque_external
        - system_status
        - friction_uncertainty
        - friction_torque

    Ports
    -----
    dynamics : abstract `DynamicsTerms` of a state sampled with this observer's period, from `RobotDynamics`.
    torque_applied : n (Nm), the torque that acts, after all limits; `torque_delay` later.
    torque_external : n (Nm), r ≈ JᵀF = −τ_ext, what others do to the robot; zero until one period has passed, NaN while
        the state is not known.
    system_status : 1, a `SystemStatus`.
    friction_uncertainty : n (Nm), by how much the identified friction may be wrong; all of it, where a joint has not
        moved yet.
    friction_torque : n (Nm), what the identified friction does to the joints.

    The velocity may be late too: then σ is integrated with the torque up to the time of which the velocity tells. A
    delay that is not told appears as external torque wherever the torque changes: half a period of 5 ms with a gain of
    100 1/s as a fifth of each change.
    Law: ṙ = −K_I (r + τ_ext) in continuous time; at the samples, its exact discretization for a held τ_ext. There is
    no delay but that of the average: r at a sample uses the momentum of that sample. A mistake of model or friction
    appears as external torque.
    Friction and the drives' bias act beside the torque: `JointFriction`, from the measured way of the joints; that of
    the model file is known from the start, where it is viscous.
    After a state or torque that was not finite it starts anew, as at the beginning.
    """

    def __init__(self, robot: RobotModel, params: MomentumObserverParameters | None = None) -> None:
        super().__init__()
        params = params or MomentumObserverParameters()
        self._period = params.period
        self._gain = discrete_gain(diagonal(params.gain, robot.n, "gain"), params.period)
        terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        self._dynamics = DynamicsInput(self, terms)
        self._torque = self.DeclareVectorInputPort("torque_applied", BasicVector(robot.n))
        self._delay, n = params.delay, robot.n
        self._kept, self._others = int(np.ceil(self._delay)), params.averaged - 1
        self._friction, self._none = joint_friction(params.friction, robot), np.zeros(n)
        self._rubs = bool(self._friction.coulomb.any() or self._friction.viscous.any())
        self._memory = self.DeclareDiscreteState((2 + self._others + self._kept) * n + 2)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)
        start = _Estimate(self._none, self._none, self._none, self._none)
        self._estimate = declare_cache(
            self, "residual", start, self._evaluate, {self._dynamics.ticket(), self.xd_ticket()}
        )
        readouts = {
            "torque_external": (n, lambda e: e.averaged),
            "system_status": (1, lambda e: [status_of(e.averaged)]),
            "friction_uncertainty": (n, lambda e: e.unsure),
            "friction_torque": (n, lambda e: e.rubbing),
        }
        declare_readouts(self, self._estimate, readouts)

    def _remembered(self, context: Context) -> _Memory:
        x, n = np.array(context.get_discrete_state(self._memory).value()), len(self._none)
        rows = x[:-2].reshape(-1, n)
        return _Memory(rows[0], rows[1], rows[2 : 2 + self._others], rows[2 + self._others :], int(x[-2]), x[-1] == 1.0)

    def _evaluate(self, context: Context) -> _Estimate:
        memory, terms = self._remembered(context), self._dynamics.Eval(context)
        r = averaged = residual(terms.p, memory.sigma(terms), self._gain)
        if self._others:
            averaged = np.mean(np.vstack([r, memory.recent]), axis=0)
        if not self._rubs:
            return _Estimate(r, averaged, self._none, self._none)
        friction, share = self._friction, memory.share
        return _Estimate(r, averaged, friction.uncertainty(share), friction.torque(share, terms.v))

    def _update(self, context: Context, state: State) -> None:
        memory, r = self._remembered(context), self._estimate.Eval(context).r
        torque, terms = self._torque.Eval(context), self._dynamics.Eval(context)
        following = np.zeros((2 + self._others + self._kept) * len(torque) + 2)
        if all_finite(torque) and terms.finite:
            torques, share, rubbing = np.vstack([torque, memory.past[: memory.filled]]), memory.share, self._none
            if self._rubs:
                share = self._friction.after(share, self._period * terms.v)
                rubbing = self._friction.torque(share, terms.v)
            acting = delayed(torques, self._delay) + self._friction.bias + rubbing
            integral = advance_integral(memory.sigma(terms), r, acting, terms, self._period)
            kept, recent = torques[: self._kept], np.vstack([r, memory.recent])[: self._others]
            known = np.concatenate([share, integral, recent.ravel(), kept.ravel()])
            if all_finite(integral):
                following[: len(known)], following[-2:] = known, (len(kept), 1.0)
        state.get_mutable_discrete_state(self._memory).SetFromVector(following)
