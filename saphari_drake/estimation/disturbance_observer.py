"""Disturbance observer that sees the external torque through the error of the main task, eq. (42) and (44)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.parameters import diagonal, require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle

Array = NDArray[np.float64]


@dataclass
class DisturbanceObserverParameters:
    """Gain of the estimate."""

    # 1/s; frequency of the loop through the estimate, with Γ⁻¹ = rate² M(home), which is the same for heavy and light
    # parts of the arm. A.
    rate: float = 60.0
    # Diagonal of Γ instead, one value or one a joint; empty: as above. A small one suits continuous time: 0.002 makes a
    # loop of 400 1/s through the wrist of the LWR4, which is unstable at a cycle of 2 ms. A.
    Gamma: list[float] | float = field(default_factory=list)
    # 1/s; how fast the estimate is forgotten while the task yields: it says nothing of what comes after. A.
    forget_rate: float = 10.0
    # s; the control cycle.
    period: float = 0.002

    def __post_init__(self) -> None:
        require_positive(self, "rate", "forget_rate", "period")
        if np.size(self.Gamma):
            require_positive(self, "Gamma")


def advance_estimate(estimate: Array, drive: Array, Gamma_inv: Array, period: float) -> Array:
    """Return τ̂ after one period of dτ̂/dt = +Γ⁻¹ y (n,).

    Here y = J_M^# s with s = x̃' + P x̃ in Proposition 1 (42), and y = J_M^#(x̃' + γ f(x̃)) in Proposition 2 (44).
    Corrected: the sign (printed −: the estimate runs away from the torque, and the arm with it, 0.1 to 0.25 s after
    contact) and J_M^# (printed Moore–Penrose). With V = ½ sᵀΛ_x s + ½ τ̃ᵀΓ τ̃ and τ̃ = τ_ext − τ̂, this is what
    cancels sᵀJ_M^{#T}τ̃ and leaves V̇ = −sᵀK s.

    Parameters
    ----------
    estimate, drive : (n,) arrays
        τ̂ (Nm) and y (rad/s or m/s).
    Gamma_inv : (n, n) array
        Γ⁻¹, constant, symmetric and positive definite.
    """
    return estimate + period * (Gamma_inv @ drive)


class DisturbanceObserver(LeafSystem):
    """Integrates what disturbs the main task into an estimate of the external torque.

    .. pydrake_system::

        name: DisturbanceObserver
        input_ports:
        - observer_drive
        - yielding
        output_ports:
        - torque_estimated

    Ports
    -----
    observer_drive : n (rad/s or m/s), y from `NullSpaceComplianceController`; zero while its torque is cut or its task
        yields, so that the estimate does not wind up.
    yielding : 1, from the same controller, optional; τ̂ decays at `forget_rate` times this.
    torque_estimated : n (Nm), τ̂; starts at zero.

    Law: `advance_estimate`. Only J_M^{#T}τ̂, the part that moves the task, converges to that of τ_ext; τ̂ itself stays
    bounded. A mistake of model or friction that moves the task is absorbed too.
    """

    def __init__(self, robot: RobotModel, params: DisturbanceObserverParameters | None = None) -> None:
        super().__init__()
        params = params or DisturbanceObserverParameters()
        self._period, self._forget = params.period, params.forget_rate
        if np.size(params.Gamma):
            self.Gamma_inv = np.diag(1.0 / diagonal(params.Gamma, robot.n, "Gamma"))
        else:
            self.Gamma_inv = params.rate**2 * evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).M
        self._drive = self.DeclareVectorInputPort("observer_drive", BasicVector(robot.n))
        self._yielding = self.DeclareVectorInputPort("yielding", BasicVector(1))
        self._estimate = self.DeclareDiscreteState(robot.n)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)
        self.DeclareStateOutputPort("torque_estimated", self._estimate)

    def _update(self, context: Context, state: State) -> None:
        estimate = np.array(context.get_discrete_state(self._estimate).value())
        estimate = advance_estimate(estimate, self._drive.Eval(context), self.Gamma_inv, self._period)
        if self._yielding.HasValue(context):
            estimate = estimate * np.exp(-self._period * self._forget * self._yielding.Eval(context)[0])
        state.get_mutable_discrete_state(self._estimate).SetFromVector(estimate)
