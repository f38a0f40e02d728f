"""Disturbance observer that sees the external torque through the error of the main task, eq. (42) and (44)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.messages import SystemStatus
from saphari_drake.parameters import diagonal, require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class DisturbanceObserverParameters:
    """Gain of the estimate."""

    # 1/s; frequency of the loop through the estimate, with Γ⁻¹ = rate² M(home), which is the same for heavy and light
    # parts of the arm. Assumed.
    rate: float = 60.0
    # Diagonal of Γ instead, one value or one a joint; empty: as above. A small one suits continuous time: 0.002 makes a
    # loop of 400 1/s through the wrist of the LWR4, which is unstable at a cycle of 2 ms. Assumed.
    Gamma: list[float] | float = field(default_factory=list)
    # 1/s; how fast the estimate is forgotten while the task yields: it says nothing of what comes after. Assumed.
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
        - torque_excess
        output_ports:
        - torque_external
        - system_status

    Ports
    -----
    observer_drive : n (rad/s or m/s), y from `NullSpaceComplianceController`; zero while its task yields or returns.
    yielding : 1, from the same controller, optional; τ̂ decays at `forget_rate` times this.
    torque_excess : n (Nm), what the torque limit cuts off, optional; while it cuts, nothing is integrated, so that the
        estimate does not wind up.
    torque_external : n (Nm), −τ̂, what others do to the robot; starts at zero.
    system_status : 1, a `SystemStatus`; while it is BAD_INPUT, τ̂ is forgotten.

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
        self._optional = [
            self.DeclareVectorInputPort(name, BasicVector(size))
            for name, size in (("yielding", 1), ("torque_excess", robot.n))
        ]
        self._estimate = self.DeclareDiscreteState(robot.n)  # τ̂
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(params.period), update=self._update)
        state, ports = self.discrete_state_ticket(self._estimate), (self._drive, *self._optional)
        estimate = declare_cache(self, "estimate", np.zeros(robot.n), self._external, {state})
        declare_readouts(self, estimate, {"torque_external": (robot.n, lambda torque: torque)})
        self.DeclareVectorOutputPort("system_status", BasicVector(1), self._status, {port.ticket() for port in ports})

    def _external(self, context: Context) -> Array:
        return -context.get_discrete_state(self._estimate).value()

    def _inputs(self, context: Context) -> tuple[Array, float, bool]:
        """Return y (n,), how far the task yields, and whether all inputs are finite; if not, as if it yielded."""
        drive = self._drive.Eval(context)
        yielding, excess = (
            port.Eval(context) if port.HasValue(context) else np.zeros(port.size()) for port in self._optional
        )
        if not np.isfinite(np.concatenate((drive, yielding, excess))).all():
            return np.zeros(len(drive)), 1.0, False
        return np.zeros(len(drive)) if excess.any() else drive, float(yielding[0]), True

    def _status(self, context: Context, output: BasicVector) -> None:
        *_, finite = self._inputs(context)
        output.SetAtIndex(0, float(SystemStatus.OK if finite else SystemStatus.BAD_INPUT))

    def _update(self, context: Context, state: State) -> None:
        drive, yielding, _ = self._inputs(context)
        estimate = np.array(context.get_discrete_state(self._estimate).value())
        estimate = advance_estimate(estimate, drive, self.Gamma_inv, self._period)
        estimate *= np.exp(-self._period * self._forget * yielding)
        state.get_mutable_discrete_state(self._estimate).SetFromVector(estimate)
