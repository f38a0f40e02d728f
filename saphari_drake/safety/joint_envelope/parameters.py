"""What bounds a joint beside the limits of its robot, and how fast the robot can surely stop."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class JointEnvelopeParameters:
    """Limits beyond those of the robot's file, and what a stop has to cope with."""

    # Nm/s (N/s), largest rate of a joint's torque; a value that Franka's control interface gives for the Panda.
    torque_rate: float = 1000.0
    # J, largest kinetic energy; infinite: none.
    kinetic_energy: float = np.inf
    # Share of the energy kept for what the inertia changes during a stop. Assumed; 0.17 was needed in random trials.
    energy_reserve: float = 0.25
    # Share of the torque limits that a push may take while the robot brakes. Assumed.
    push_share: float = 0.1
    # Share of the velocity limits at which all joints are taken to move at once when a stop begins. Assumed.
    speed_share: float = 0.5
    # Share of the torque rate kept for changes of gravity, of velocity terms and of pushes. Assumed.
    rate_reserve: float = 0.5
    # Share of the velocity limits kept for the noise of the measured velocity. Assumed.
    speed_margin: float = 0.01
    # rad or m, kept from the position limits.
    position_margin: float = 0.001
    # Postures, drawn at random, from which the sure deceleration is found (≥ 1).
    postures: int = 2000
    # s; a command that stays the same, bit for bit, for as long while the measured state changes comes from a dead
    # controller; .inf: a command may be constant. Assumed: six cycles of 5 ms.
    stale_time: float = 0.03
    # 1/s² and 1/s, stiffness and damping over inertia of the posture that is held then. Assumed.
    hold_stiffness: float = 225.0
    hold_damping: float = 30.0
    # s, from a torque to its effect; a whole number of periods.
    torque_delay: float = 0.0
    # s, how much older than the position the measured velocity is: half a period if it is the difference of positions.
    velocity_age: float = 0.0005
    # s, over which torque_mean goes: the period of those that are fed with it. A whole number of periods.
    mean_time: float = 0.005
    # s, the robot's own cycle.
    period: float = 0.001

    def __post_init__(self) -> None:
        require_positive(self, "torque_rate", "postures", "hold_stiffness", "hold_damping", "mean_time", "period")
        if not self.stale_time > 0.0:
            raise ParameterError("stale_time", f"must be positive, got {self.stale_time}")
        require_non_negative(self, "position_margin", "torque_delay", "velocity_age")
        if not self.kinetic_energy > 0.0:
            raise ParameterError("kinetic_energy", f"must be positive, got {self.kinetic_energy}")
        for name in ("energy_reserve", "push_share", "rate_reserve", "speed_share", "speed_margin"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ParameterError(name, f"must lie in [0, 1), got {getattr(self, name)}")
        if self.velocity_age > self.period:
            raise ParameterError("velocity_age", f"must be at most a period, got {self.velocity_age}")
        self.periods("torque_delay"), self.periods("mean_time")

    def periods(self, name: str) -> int:
        """Return how many periods a time has.

        Raises
        ------
        ParameterError
            If it is no whole number of them.
        """
        count = getattr(self, name) / self.period
        if abs(count - round(count)) > 1e-6:
            raise ParameterError(name, f"must be a multiple of the period {self.period} s, got {getattr(self, name)}")
        return round(count)


class Envelope(NamedTuple):
    """The envelope of one robot as arrays (n,)."""

    q_min: Array  # rad or m
    q_max: Array
    margin: float  # rad or m, from there to the limits of the robot
    v_max: Array  # rad/s or m/s
    tau_max: Array  # Nm or N
    tau_rate: Array  # Nm/s or N/s
    deceleration: Array  # rad/s² or m/s², of a stop that is surely possible
    jerk: Array  # rad/s³ or m/s³, with which it surely begins
    jerk_full: Array  # rad/s³ or m/s³, with which it begins where nothing else takes its share of the torque's rate
    energy: float  # J, less the reserve
    period: float  # s
    viscous: Array  # Nms/rad or Ns/m, friction of the joints


def envelope_of(robot: RobotModel, params: JointEnvelopeParameters) -> Envelope:
    """Return the envelope of a robot, with the deceleration and jerk of a stop that its motors surely give.

    With all joints anywhere within limits, moving and decelerating in any direction, Σ_j |M_ij| A_j + |C q̇ + g|_i +
    push_share τ_max,i ≤ τ_max,i, and Σ_j |M_ij| J_j ≤ (1 − rate_reserve) τ̇_max,i. Both hold over random postures, which
    is evidence, no proof, for those between them. What is left over goes to single joints, halves at a time. A
    deceleration that takes the jerk more than a quarter of the velocity limit to reach is not asked for: A² ≤ J v/2.

    Raises
    ------
    ParameterError
        If the motors cannot hold the robot against gravity, push and velocity terms in some posture.
    """
    n, rng = robot.n, np.random.default_rng(0)
    reach = np.where(np.isfinite(robot.v_max), robot.v_max, 1.0)
    low, high = np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi)
    inertia, load = np.empty((params.postures, n, n)), np.empty((params.postures, n))
    for k in range(params.postures):
        v = params.speed_share * reach * rng.choice([-1.0, 0.0, 1.0], n)
        terms = evaluate_dynamics(robot, rng.uniform(low, high), v)
        inertia[k], load[k] = np.abs(terms.M), np.abs(terms.Cv + terms.g)
    left = (1.0 - params.push_share) * robot.tau_max - load
    if left.min() <= 0.0:
        joint = int(np.argmin(left.min(axis=0)))
        raise ParameterError("push_share", f"joint '{robot.joint_names[joint]}' cannot stop against gravity and push")
    rate = np.full(n, params.torque_rate)
    jerk = _shared(inertia, np.broadcast_to((1.0 - params.rate_reserve) * rate, left.shape), reach)
    deceleration = np.minimum(_shared(inertia, left, reach), np.sqrt(0.5 * jerk * reach))
    return Envelope(
        robot.q_min + params.position_margin,
        robot.q_max - params.position_margin,
        params.position_margin,
        (1.0 - params.speed_margin) * robot.v_max,
        robot.tau_max,
        rate,
        deceleration,
        jerk,
        jerk / (1.0 - params.rate_reserve),
        (1.0 - params.energy_reserve) * params.kinetic_energy,
        params.period,
        robot.viscous,
    )


def _shared(inertia: Array, left: Array, weight: Array) -> Array:
    """Return x (n,) with |M| x ≤ left in all postures (k, n): in the ratio of `weight`, and more where it fits."""
    x = 0.5 * weight * np.min(left / (inertia @ weight))
    for _ in range(6):
        for i in range(len(x)):
            x[i] += 0.5 * np.min((left - inertia @ x) / np.maximum(inertia[:, :, i], 1e-12))
    return x
