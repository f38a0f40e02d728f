"""What the residual shows while nobody touches: masses that are not those of the model, a tool, a torque offset."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.estimation.model_error_law import Learned, counted, forgotten, learn, prior, sensitivity
from saphari_drake.estimation.momentum_observer import discrete_gain
from saphari_drake.messages import Immutable, status_of
from saphari_drake.parameters import diagonal, require_non_negative, require_positive
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_outputs, declare_readouts

Array = NDArray[np.float64]


@dataclass
class ModelErrorParameters:
    """What the model may lack, as standard deviations, and when it is learned. All assumed."""

    # Relative error of each link's mass. 0, with a tool of no mass and no offset: nothing is learned.
    mass: float = 0.05
    # kg and m; unknown tool in the last link, and how far its centre is from that link's origin.
    tool_mass: float = 0.5
    tool_offset: float = 0.1
    # Nm (N), constant torque of each joint that no model explains; one value or one a joint.
    offset: list[float] | float = 0.3
    # Nm (N); what friction at rest may hide of each joint is not learned: as a correction it would only shift friction.
    stiction: list[float] | float = 0.0
    # rad (m); way of a joint over which its offset is forgotten, as friction and ripple change with it (0: never); less
    # way than the second does not count. Nms/rad (Ns/m); friction that nobody knows grows with speed.
    offset_way: float = 0.02
    least_way: float = 0.001
    viscous: float = 1.0
    # s; within which offsets may change, and what is known already is learned anew.
    drift_time: float = 20.0
    # Nm (N), standard deviation of the residual from cycle to cycle; from then on it is measured.
    noise: list[float] | float = 0.05
    # s and Nm (N); within which the noise is measured, and the largest that counts as noise.
    noise_time: float = 2.0
    noise_limit: float = 1.0
    # The uncertainty that is put out, and the limits of all that is learned, in standard deviations.
    multiple: float = 3.0
    # Share of the change of momentum that the model's inertia does not explain.
    inertia: float = 0.1
    # s; in the first moments of learning nobody touches: whatever is no contact is learned, at once.
    start_time: float = 0.3
    # Nm (N); later it stops when the residual is farther than this from what is expected, uncertainty included,
    suspicion: float = 0.5
    # while a joint is faster than this (rad/s or m/s),
    still_speed: float = 0.1
    # and until neither has been so for this long (s).
    quiet_time: float = 0.2
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        names = "mass", "tool_mass", "tool_offset", "offset", "stiction", "offset_way", "viscous", "inertia"
        require_non_negative(self, *names)
        require_positive(
            self, "least_way", "drift_time", "noise", "noise_time", "noise_limit", "multiple", "start_time",
            "suspicion", "still_speed", "quiet_time", "period",
        )  # fmt: skip


class LearningStatus(IntEnum):
    """Whether the model's error is being learned, also published as a number."""

    LEARNING = 0
    TOUCHED = 1  # a contact is felt or suspected, or was a moment ago
    MOVING = 2  # a joint is too fast
    LIMITED = 3  # learning, but something is at its limit: the robot is not the one that the parameters describe


@dataclass(frozen=True)
class _Memory(Immutable):
    learned: Learned
    lagged: Array  # (n, k) regressor behind the observer's lag
    p_lagged: Array  # (n,) momentum behind it
    r: Array  # (n,) residual of the cycle before
    noise: Array  # (n,) its variance
    quiet: float  # s
    place: Array  # (n,) joint positions up to which ways have been counted
    time: float = 0.0  # s, of learning
    started: bool = False
    status: LearningStatus = LearningStatus.LEARNING


class _Estimate(NamedTuple):
    terms: DynamicsTerms
    H: Array
    error: Array  # r − H θ, with H behind the observer's lag
    bias: Array  # H θ
    uncertainty: Array


class ModelErrorEstimator(LeafSystem):
    """Learns, while nobody touches, what the model lacks, and corrects gravity and residual by it.

    .. pydrake_system::

        name: ModelErrorEstimator
        input_ports:
        - dynamics
        - torque_external
        - contact
        output_ports:
        - dynamics
        - torque_external
        - model_torque
        - torque_uncertainty
        - system_status
        - torque_noise
        - tool_mass
        - learning_status

    Ports
    -----
    dynamics (input) : abstract `DynamicsTerms` of the model.
    torque_external (input) : n (Nm or N), the residual of that model, from `MomentumObserver`.
    contact : 1, from `ContactDetector`; optional: then suspicion alone stops the learning.
    dynamics (output) : the same with g corrected, for all that control or limit.
    torque_external (output) : n (Nm or N), the residual without what is learned.
    model_torque : n (Nm or N), g corrected minus g of the model.
    torque_uncertainty : n (Nm or N), how far the corrected residual can be from zero though nobody touches, noise
        apart: what is not learned yet at this posture, and the inertia's error.
    torque_noise : n (Nm or N), measured standard deviation of the corrected residual.
    tool_mass : 1 (kg), of the tool as far as it is learned; one posture does not tell it from a heavier link.
    learning_status : 1, a `LearningStatus`.
    system_status : 1, a `SystemStatus`; while it is BAD_INPUT nothing is learned and the residual is passed as it is.

    Model: r = −W(q) θ + b, with the columns of `weight_regressor` for relative errors of the links' masses and a tool,
    and an offset b a joint. θ and b are estimated by a Kalman filter whose prior are the parameters and which sees W
    through the observer's lag. A posture teaches one combination of θ; at another posture the rest of their covariance
    makes the uncertainty. Hence the uncertainty is large in the first moments, small where the arm has been at rest,
    and grows on the way to where it has not: there friction holds a joint the other way, and ripple is another.

    Nobody may lean on the arm while it starts, or comes to rest elsewhere: what is no contact then is taken for a
    mistake of the model. Nor can the arm tell a tool that it is given later from a contact.
    """

    def __init__(
        self, robot: RobotModel, params: ModelErrorParameters | None = None, gain: list[float] | float = 50.0
    ) -> None:
        super().__init__()
        self._params, self._tree, n = params or ModelErrorParameters(), robot.tree, robot.n
        p = self._params
        noise, offset, K_I = diagonal(p.noise, n, "noise"), diagonal(p.offset, n, "offset"), diagonal(gain, n, "gain")
        self._stiction = diagonal(p.stiction, n, "stiction")
        self._gain = discrete_gain(K_I, p.period)
        self._forgetting = 2.0 / p.offset_way if p.offset_way > 0.0 else 0.0
        self._offset, start = offset, prior(n, p.mass, p.tool_mass, p.tool_offset, offset)
        self._limits = p.multiple * np.sqrt(np.diag(start.covariance))
        # The residual is filtered: neighbouring samples are not independent.
        self._variance = noise**2 * (1.0 + 2.0 / (K_I * p.period))
        drift = (p.period / p.drift_time) ** 2 * (offset > 0.0) * self._variance
        self._drift = np.concatenate([np.zeros(n + 4), drift])
        terms, zero = evaluate_dynamics(robot, robot.home, np.zeros(n)), np.zeros(n)
        self._dynamics = DynamicsInput(self, terms)
        self._residual = self.DeclareVectorInputPort("torque_external", BasicVector(n))
        self._contact = self.DeclareVectorInputPort("contact", BasicVector(1))
        H = sensitivity(terms.motion, self._tree)
        self._learn(start, H, zero)  # compiled before the first control step
        memory = _Memory(start, 0.0 * H, zero, zero, noise**2, p.quiet_time, zero)
        self._memory = self.DeclareAbstractState(AbstractValue.Make(memory))
        state = self.abstract_state_ticket(self._memory)
        tickets = {self._dynamics.ticket(), self._residual.ticket(), state}
        first = _Estimate(terms, H, zero, zero, zero)
        estimate = self._estimate = declare_cache(self, "estimate", first, self._evaluate, tickets)
        declare_outputs(self, estimate.Eval, estimate.ticket(), first, {"dynamics": lambda e: e.terms})
        readouts = {
            "torque_external": (n, lambda e: e.error),
            "model_torque": (n, lambda e: -e.bias),
            "torque_uncertainty": (n, lambda e: e.uncertainty),
            "system_status": (1, lambda e: [status_of(e.error)]),
        }
        declare_readouts(self, estimate, readouts)
        reads = {
            "torque_noise": lambda m: np.sqrt(m.noise),
            "tool_mass": lambda m: [m.learned.theta[n]],
            "learning_status": lambda m: [float(m.status)],
        }
        declare_outputs(self, self._remembered, state, memory, reads)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(p.period), update=self._update)

    def _learn(self, learned: Learned, H: Array, r: Array, time: float = 0.0) -> Learned:
        p = self._params
        # Later each residual weighs so little that what is known needs the drift time to change.
        slower = p.drift_time / p.start_time if time > p.start_time else 1.0
        return learn(learned, H, r, slower * self._variance, self._drift, self._limits)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _evaluate(self, context: Context) -> _Estimate:
        p, memory, r = self._params, self._remembered(context), np.array(self._residual.Eval(context))
        terms: DynamicsTerms = self._dynamics.Eval(context)
        learned, zero = memory.learned, np.zeros(len(r))
        if not terms.finite:
            return _Estimate(terms, 0.0 * memory.lagged, np.full(len(r), np.nan), zero, zero)
        H = sensitivity(terms.motion, self._tree)
        bias, variance = H @ learned.theta, np.einsum("ij,jk,ik->i", H, learned.covariance, H)
        change = self._gain * (terms.p - memory.p_lagged) if memory.started else zero
        unsure = p.multiple * np.sqrt(np.maximum(variance, 0.0)) + p.viscous * np.abs(terms.v)
        unsure = unsure + p.inertia * np.abs(change)
        return _Estimate(terms.with_gravity(terms.g - bias), H, r - memory.lagged @ learned.theta, bias, unsure)

    def _update(self, context: Context, state: State) -> None:
        before, now, r = self._remembered(context), self._estimate.Eval(context), self._residual.Eval(context)
        if np.isfinite(now.error).all():
            contact = self._contact.Eval(context)[0] if self._contact.HasValue(context) else 0.0
            memory = self._after(before, now, np.array(r), not contact <= 0.5)
        else:  # the observer starts anew
            status, unknown = LearningStatus.TOUCHED, 0.0 * before.lagged
            memory = replace(before, lagged=unknown, quiet=0.0, started=False, status=status)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)

    def _after(self, before: _Memory, now: _Estimate, r: Array, touched: bool) -> _Memory:
        p, terms, noise = self._params, now.terms, before.noise
        place = counted(before.place, terms.q, p.least_way) if before.started else terms.q
        ways = self._forgetting * np.abs(place - before.place) * before.started
        learned = forgotten(before.learned, -np.expm1(-ways), self._offset)
        pass_, moving = self._gain * p.period, bool(np.max(np.abs(terms.v)) > p.still_speed)
        if before.started and not (touched or moving):
            # Filtered white noise of variance σ² differs from sample to sample by 2 σ² times what the filter lets pass.
            now_noise = 0.5 * (r - before.r) ** 2 / pass_
            noise = np.minimum(noise + p.period / p.noise_time * (now_noise - noise), p.noise_limit**2)
        expected = now.uncertainty + np.maximum(p.suspicion, p.multiple * np.sqrt(noise))
        suspected = before.time > p.start_time and bool(np.any(np.abs(now.error) > expected))
        touched = touched or suspected
        quiet = 0.0 if touched or moving else before.quiet + p.period
        status = LearningStatus.MOVING if moving and not touched else LearningStatus.TOUCHED
        learning = quiet >= p.quiet_time
        if learning:
            hidden = np.clip(now.error, -self._stiction, self._stiction)
            learned = self._learn(learned, before.lagged, r - hidden, before.time)
            status = LearningStatus.LIMITED if learned.limited else LearningStatus.LEARNING
        p_lagged = before.p_lagged if before.started else terms.p
        lagged = before.lagged + pass_[:, None] * (now.H - before.lagged)
        p_lagged = p_lagged + pass_ * (terms.p - p_lagged)
        time = before.time + learning * p.period
        return _Memory(learned, lagged, p_lagged, r, noise, quiet, place, time, True, status)
