"""How fast the velocity of each joint may change, from what its motors surely give."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class VelocityEnvelopeParameters:
    """Limits beyond those of the robot's file, and what the motors need their torque for besides."""

    # rad/s² or m/s², largest acceleration, one value or one a joint; infinite: what the motors surely give.
    acceleration_max: list[float] = field(default_factory=lambda: [np.inf])
    # s, from rest to the velocity limit at least: what light wrists could do faster, the servo overshoots. Assumed.
    full_speed_time: float = 0.04
    # s, in which an acceleration rises from zero to its largest. Assumed; Franka's limits for the Panda give 0.002.
    rise_time: float = 0.01
    # Nm/s (N/s), largest rate of a joint's torque, that of the `JointEnvelope` behind; infinite: any.
    torque_rate: float = np.inf
    # Share of the torque limits kept for pushes and for what the servo corrects. Assumed.
    torque_reserve: float = 0.1
    # Share of the velocity limits at which all joints are taken to move at once. Assumed.
    speed_share: float = 0.5
    # Share of the velocity limits kept for what the servo overshoots. Assumed; `JointVelocityServo` needed 0.007.
    speed_margin: float = 0.01
    # rad or m, kept from the position limits.
    position_margin: float = 0.001
    # s, by which the joints follow the applied velocity at most. Assumed; `JointVelocityServo` at 1 ms needs 0.002.
    lag: float = 0.005
    # s; a command other than zero that stays the same, bit for bit, for as long while the position changes comes from a
    # dead controller; .inf: a command may be constant.
    stale_time: float = np.inf
    # Postures, drawn at random, over which the accelerations are found (≥ 1).
    postures: int = 2000
    # s, cycle of the velocity interface.
    period: float = 0.001

    def __post_init__(self) -> None:
        require_positive(self, "full_speed_time", "rise_time", "postures", "period")
        if not self.torque_rate > 0.0:
            raise ParameterError("torque_rate", f"must be positive, got {self.torque_rate}")
        require_non_negative(self, "position_margin", "lag")
        if not self.stale_time > 0.0:
            raise ParameterError("stale_time", f"must be positive, got {self.stale_time}")
        if not np.all(np.asarray(self.acceleration_max, dtype=float) > 0.0):
            raise ParameterError("acceleration_max", f"must be positive, got {self.acceleration_max}")
        for name in ("torque_reserve", "speed_share", "speed_margin"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ParameterError(name, f"must lie in [0, 1), got {getattr(self, name)}")


class Bounds(NamedTuple):
    """The velocity envelope of one robot as arrays (n,)."""

    q_min: Array  # rad or m
    q_max: Array
    v_max: Array  # rad/s or m/s
    acceleration: Array  # rad/s² or m/s²
    jerk: Array  # rad/s³ or m/s³
    slip: Array  # rad or m, farthest that a joint is from where the applied velocities lead
    period: float  # s


def bounds_of(robot: RobotModel, params: VelocityEnvelopeParameters) -> Bounds:
    """Return the velocity envelope of a robot.

    All joints at once may accelerate in any directions: Σ_j |M_ij| A_j + |C q̇ + g|_i ≤ (1 − torque_reserve) τ_max,i.
    That holds over random postures within the limits, each joint at rest or at ±speed_share of its speed: evidence, no
    proof, for what lies between. First all get the same share of what is wanted, then single joints what is left over.
    The jerks J of all joints at once keep the rate of the torque: Σ_j |M_ij| J_j ≤ (1 − torque_reserve) τ̇_max.

    Raises
    ------
    ModelError
        If a joint has no velocity limit.
    ParameterError
        If the motors cannot hold the robot in some posture.
    """
    n = robot.n
    if not np.isfinite(robot.v_max).all():
        raise ModelError(f"{robot.name}: a velocity envelope needs a velocity limit of every joint")
    wanted = np.broadcast_to(np.asarray(params.acceleration_max, dtype=float), (n,))
    inertia, left = _random_loads(robot, params)
    if left.min() <= 0.0:
        joint = robot.joint_names[int(np.argmin(left.min(axis=0)))]
        raise ParameterError("torque_reserve", f"joint '{joint}' cannot hold its load with what is left")
    acceleration = np.minimum(_shared(inertia, left, wanted, robot.v_max), robot.v_max / params.full_speed_time)
    jerk = acceleration / params.rise_time
    if np.isfinite(params.torque_rate):
        rate = np.full(n, (1.0 - params.torque_reserve) * params.torque_rate)
        jerk = np.minimum(jerk, _shared(inertia, rate, np.full(n, np.inf), robot.v_max))
    return Bounds(
        robot.q_min + params.position_margin,
        robot.q_max - params.position_margin,
        (1.0 - params.speed_margin) * robot.v_max,
        acceleration,
        jerk,
        params.position_margin + params.lag * robot.v_max,
        params.period,
    )


def _random_loads(robot: RobotModel, params: VelocityEnvelopeParameters) -> tuple[Array, Array]:
    """Return |M| (k, n, n) in random postures, and the torques (k, n) left for accelerations there."""
    n, rng = robot.n, np.random.default_rng(0)
    low, high = np.maximum(robot.q_min, -np.pi), np.minimum(robot.q_max, np.pi)
    inertia, left = np.empty((params.postures, n, n)), np.empty((params.postures, n))
    for k in range(params.postures):
        v = params.speed_share * robot.v_max * rng.choice([-1.0, 0.0, 1.0], n)
        terms = evaluate_dynamics(robot, rng.uniform(low, high), v)
        inertia[k] = np.abs(terms.M)
        left[k] = (1.0 - params.torque_reserve) * robot.tau_max - np.abs(terms.Cv + terms.g)
    return inertia, left


def _shared(inertia: Array, left: Array, wanted: Array, speed: Array) -> Array:
    """Return x (n,) ≤ wanted with |M| x ≤ left in all postures: in the ratio of what is wanted, then more if it fits.

    Without a wish the ratio is that of the speeds, of which half is shared at first.
    """
    wish = np.where(np.isfinite(wanted), wanted, speed * np.min(left / (inertia @ speed)))
    x = wish * min(1.0, float(np.min(left / (inertia @ wish))))
    x = np.where(np.isfinite(wanted), x, 0.5 * x)
    for _ in range(6):
        for i in range(len(x)):
            more = 0.5 * np.min((left - inertia @ x) / np.maximum(inertia[:, :, i], 1e-12))
            x[i] = min(x[i] + max(more, 0.0), wanted[i])
    return x
