"""Whether the wrist sensor tells of the force that the joints feel."""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.estimation.momentum_observer import discrete_gain
from saphari_drake.messages import Immutable, SkinReading, SkinStatus
from saphari_drake.parameters import require_non_negative, require_positive, require_vector
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_outputs

Array = NDArray[np.float64]


@dataclass
class WrenchCheckParameters:
    """How the two are compared; assumed."""

    # Frame of the robot and point in it (m) that the wrench refers to.
    tip_frame: str = "link_7"
    tip_point: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    # 1/s; of the observer, behind whose lag the measured forces are compared.
    gain: float = 50.0
    # Nm (N); sudden difference of a joint's torque that dry friction (0.3 Nm, reversed) and the error of the model's
    # inertia do not make,
    tolerance: float = 2.0
    # Nms/rad (Ns/m); more by this for each change of the joint's speed: viscous friction that nobody has identified.
    viscous: float = 1.0
    # s; for how long it must last, and for how long all must agree again.
    time: float = 0.02
    recovery_time: float = 0.5
    # s; slower differences are learned: errors of the model at another posture.
    drift_time: float = 1.0
    # s; the control cycle.
    period: float = 0.002

    def __post_init__(self) -> None:
        require_positive(self, "gain", "tolerance", "recovery_time", "drift_time", "period")
        require_non_negative(self, "viscous", "time")
        require_vector(self, 3, "tip_point")


class WrenchCheckStatus(IntEnum):
    """Whether the wrench is believed, also published as a number."""

    OK = 0
    DOUBTED = 1  # the joints feel something else


@dataclass(frozen=True)
class _Memory(Immutable):
    lagged: Array  # (n,) Nm, of the measured forces behind the observer's lag
    learned: Array  # (n,) Nm, difference that is no fault
    v: Array  # (n,) rad/s, speed at which it was learned
    started: bool = False
    bad: float = 0.0  # s, for which they have differed
    good: float = 0.0  # s, since they agree
    status: WrenchCheckStatus = WrenchCheckStatus.OK


class WrenchCheck(LeafSystem):
    """Passes a measured wrench on while the joints feel the same force; else NaN.

    .. pydrake_system::

        name: WrenchCheck
        input_ports:
        - dynamics
        - wrench_measured
        - skin
        - torque_external
        output_ports:
        - wrench_checked
        - status

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    wrench_measured : 6 (Nm, N), moment and force of the person on the robot at the tip, world axes.
    skin : abstract `SkinReading`, of what else touches the robot; optional: nothing.
    torque_external : n (Nm or N), of the same, from `MomentumObserver`.
    wrench_checked : 6 (Nm, N), the same as measured; NaN while it is not believed.
    status : 1, a `WrenchCheckStatus`.

    Law: r − JᵉᵀFᵉ − JᵇᵀFᵇ, with the measured forces behind the observer's lag, less what it was on average over
    `drift_time`, stays within `tolerance` in each joint, and more for a speed that is not the average one. Slow errors
    of either are learned: a bias that grows slowly is not noticed, nor one whose torque is below the tolerance. A
    sudden touch where neither wrist nor skin feels is doubted as well: the arm stops then. What is not finite is passed
    on, and nothing is learned from it.
    """

    def __init__(self, robot: RobotModel, params: WrenchCheckParameters | None = None) -> None:
        super().__init__()
        p = self._params = params or WrenchCheckParameters()
        link, X_LF = robot.frame(p.tip_frame)
        self._tip = link, np.array(X_LF @ np.asarray(p.tip_point, dtype=float))
        self._share = float(discrete_gain(np.array(p.gain), p.period)) * p.period
        n = robot.n
        terms = evaluate_dynamics(robot, robot.home, np.zeros(n))
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._wrench = self.DeclareVectorInputPort("wrench_measured", BasicVector(6))
        self._skin = self.DeclareAbstractInputPort("skin", AbstractValue.Make(SkinReading()))
        self._external = self.DeclareVectorInputPort("torque_external", BasicVector(n))
        start = _Memory(*np.zeros((3, n)))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(start))
        state = self.abstract_state_ticket(self._memory)
        self.DeclareVectorOutputPort(
            "wrench_checked", BasicVector(6), self._calc, prerequisites_of_calc={state, self._wrench.ticket()}
        )
        declare_outputs(self, self._remembered, state, start, {"status": lambda memory: [float(memory.status)]})
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(p.period), update=self._update)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _calc(self, context: Context, output: BasicVector) -> None:
        doubted = self._remembered(context).status == WrenchCheckStatus.DOUBTED
        output.SetFromVector(np.full(6, np.nan) if doubted else self._wrench.Eval(context))

    def _felt(self, context: Context) -> Array:
        """Return the torque (n,) of the measured forces; not finite where one is not known."""
        terms: DynamicsTerms = self._dynamics.Eval(context)
        reading: SkinReading = self._skin.Eval(context) if self._skin.HasValue(context) else SkinReading()
        if reading.status == SkinStatus.LOST:
            return np.full(len(terms.q), np.nan)
        torque = terms.point(*self._tip).Jv_WC.T @ self._wrench.Eval(context)[3:]
        for contact in reading.contacts:
            if not 0 <= contact.link < len(terms.q):
                return np.full(len(terms.q), np.nan)
            torque = torque + terms.point(contact.link, contact.p_LC).Jv_WC.T @ (terms.R_WL[contact.link] @ contact.f_L)
        return torque

    def _update(self, context: Context, state: State) -> None:
        memory, p = self._remembered(context), self._params
        felt, r = self._felt(context), np.array(self._external.Eval(context))
        if not (np.isfinite(felt).all() and np.isfinite(r).all()):
            return
        memory = compared(memory, felt, r, self._dynamics.Eval(context).v, self._share, p)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)


def compared(memory: _Memory, felt: Array, r: Array, v: Array, share: float, params: WrenchCheckParameters) -> _Memory:
    """Return what is known one period later; `felt` (n,) of the sensors and r (n,) of the observer (Nm or N)."""
    p = params
    lagged = memory.lagged + share * (felt - memory.lagged) if memory.started else felt
    difference = r - lagged
    learned, usual = (memory.learned, memory.v) if memory.started else (difference, v)
    allowed = p.tolerance + p.viscous * np.abs(v - usual)
    agree = bool(np.all(np.abs(difference - learned) <= allowed))
    bad, good = (0.0, memory.good + p.period) if agree else (memory.bad + p.period, 0.0)
    status = memory.status
    if bad > p.time:
        status = WrenchCheckStatus.DOUBTED
    elif good >= p.recovery_time:
        status = WrenchCheckStatus.OK
    if agree and status == WrenchCheckStatus.OK:
        slow = p.period / p.drift_time
        learned, usual = learned + slow * (difference - learned), usual + slow * (v - usual)
    return _Memory(lagged, learned, usual, True, bad, good, status)
