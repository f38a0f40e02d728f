"""Momentum observer: the external joint torque from position, velocity and commanded torque alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.parameters import diagonal, require_positive
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle

Array = NDArray[np.float64]


@dataclass
class MomentumObserverParameters:
    """Bandwidth of the residual."""

    # 1/s, one for all joints or one a joint; r reaches 63 % of a step in 1/gain. 50 in the deliverable's setting, A.
    gain: list[float] | float = 50.0
    # s; the period with which the measured state is sampled.
    period: float = 0.005

    def __post_init__(self) -> None:
        require_positive(self, "gain", "period")


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


class MomentumObserver(LeafSystem):
    """Residual of the generalized momentum, eq. (45).

    .. pydrake_system::

        name: MomentumObserver
        input_ports:
        - dynamics
        - torque_commanded
        output_ports:
        - residual

    Ports
    -----
    dynamics : abstract `DynamicsTerms` of a state sampled with this observer's period, from `RobotDynamics`.
    torque_commanded : n (Nm), the torque that acts, after all limits.
    residual : n (Nm), r ≈ −τ_ext; zero until one period has passed.

    Law: ṙ = −K_I (r + τ_ext) in continuous time; at the samples, its exact discretization for a held τ_ext. There is
    no delay: r at a sample uses the momentum of that sample. A mistake of model or friction appears as external torque.
    """

    def __init__(self, robot: RobotModel, params: MomentumObserverParameters | None = None) -> None:
        super().__init__()
        params = params or MomentumObserverParameters()
        self._period = params.period
        self._gain = discrete_gain(diagonal(params.gain, robot.n, "gain"), params.period)
        terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._torque = self.DeclareVectorInputPort("torque_commanded", BasicVector(robot.n))
        self._integral = self.DeclareDiscreteState(robot.n)
        self._started = self.DeclareDiscreteState(1)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)
        self.DeclareVectorOutputPort(
            "residual",
            BasicVector(robot.n),
            self._calc,
            prerequisites_of_calc={
                self._dynamics.ticket(),
                self.discrete_state_ticket(self._integral),
                self.discrete_state_ticket(self._started),
            },
        )

    def _integral_now(self, context: Context) -> Array:
        """σ, or p before the first update: the residual starts at zero whatever the initial momentum is."""
        if context.get_discrete_state(self._started).value()[0]:
            return np.array(context.get_discrete_state(self._integral).value())
        return np.array(self._dynamics.Eval(context).p)

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(residual(self._dynamics.Eval(context).p, self._integral_now(context), self._gain))

    def _update(self, context: Context, state: State) -> None:
        integral = self._integral_now(context)
        terms = self._dynamics.Eval(context)
        r = residual(terms.p, integral, self._gain)
        torque = self._torque.Eval(context)
        integral = advance_integral(integral, r, torque, terms, self._period)
        state.get_mutable_discrete_state(self._integral).SetFromVector(integral)
        state.get_mutable_discrete_state(self._started).SetFromVector([1.0])
