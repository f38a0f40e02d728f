"""How stiff a hand may be before hand guiding oscillates with it."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import DiscreteTimeApproximation
from pydrake.systems.primitives import LinearSystem

from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.errors import StabilityWarning
from saphari_drake.parameters import positive_definite, require_non_negative, require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]
SOFTEST, STIFFEST = 50.0, 1e5  # N/m; hands that are tried
STIFF_SERVO = (4e4, 400.0)  # 1/s², 1/s; of an arm that takes positions: 200 rad/s, critically damped


@dataclass(frozen=True)
class GuidingLoop:
    """What is in the loop between the hand and the motion of a guided point, along one axis."""

    params: HandGuidingParameters = field(default_factory=HandGuidingParameters)  # period and gains
    mass: float = 5.0  # kg; M_c
    damping: float = 30.0  # Ns/m; D_c
    arm_mass: float = 3.0  # kg; effective mass of the arm at the point
    hand_damping: float = 0.0  # Ns/m
    force_lag: float = 0.0  # s; time constant of the force sensor's filter
    force_delay: int = 0  # whole cycles from the measurement of the force to its use
    servo: tuple[float, float] | None = None  # 1/s², 1/s; of an arm that takes positions; None: it takes torques
    differentiated: bool = True  # whether velocity is measured as the difference of two positions

    def __post_init__(self) -> None:
        require_positive(self, "mass", "damping", "arm_mass")
        require_non_negative(self, "hand_damping", "force_lag", "force_delay")


def transition_matrix(loop: GuidingLoop, stiffness: float) -> Array:
    """Return the matrix that takes the loop from one control cycle to the next.

    Along one axis the law (47)–(50) is linear. The state is position and velocity of the point, the position of the
    cycle before, commanded and desired position and velocity, the force that is fed forward, the filtered one and those
    under way to the controller. The hand is F = −k x − d ẋ with `stiffness` k (N/m).
    """
    p, T, m = loop.params, loop.params.period, loop.arm_mass
    filtering, smoothing = (math.exp(-T / time) if time > 0.0 else 0.0 for time in (loop.force_lag, p.force_time))
    # Each quantity is a row: its coefficients in the state.
    x, v, before, x_c, v_c, p_d, v_d, fed, filtered, *queue = np.eye(9 + loop.force_delay)
    force = filtering * filtered - (1.0 - filtering) * (stiffness * x + loop.hand_damping * v)
    *waiting, used = [force, *queue]
    fed = smoothing * fed + (1.0 - smoothing) * used
    v_m = (x - before) / T if loop.differentiated else v
    v_d_next = v_d + T * loop.damping / (loop.mass + T * loop.damping) * (used / loop.damping - v_d)
    x_a, v_a = (x_c, v_c) if loop.servo or p.feedback == "commanded" else (x, v_m)
    a = (v_d_next - v_d) / T + p.k_d * (v_d - v_a) + p.k_p * (p_d - x_a)
    v_c_next = v_c + T * a
    x_c_next = x_c + 0.5 * T * (v_c + v_c_next)
    if loop.servo is None:
        K, D, drive = 0.0, 0.0, a + p.K_D * (v_c - v_m) + p.K_P * (x_c - x) - fed / m
    else:
        K, D = loop.servo
        drive = K * x_c_next + D * v_c_next
    moved = _motion(K + stiffness / m, D + loop.hand_damping / m, T) @ [x, v, drive]
    return np.array([*moved, x, x_c_next, v_c_next, p_d + 0.5 * T * (v_d + v_d_next), v_d_next, fed, force, *waiting])


def _motion(a: float, b: float, T: float) -> Array:
    """Return the (2, 3) matrix that gives x, v after T from x, v and u, with ẍ = −a x − b ẋ + u, exactly."""
    motion = LinearSystem(A=[[0.0, 1.0], [-a, -b]], B=[[0.0], [1.0]])
    sampled = DiscreteTimeApproximation(motion, T)
    return np.hstack([sampled.A(), sampled.B()])


def growth(loop: GuidingLoop, stiffness: float) -> float:
    """Return the rate of growth of the slowest mode (1/s): negative if hand and robot come to rest together."""
    radius = float(np.abs(np.linalg.eigvals(transition_matrix(loop, stiffness))).max())
    return math.log(radius) / loop.params.period


def max_hand_stiffness(loop: GuidingLoop) -> float:
    """Return the hand stiffness (N/m) up to which hand and robot are stable together; STIFFEST if all are.

    Found by bisection on `growth` between the first unstable of 60 stiffnesses and the one before it; 0 if the softest
    is unstable already.
    """
    grid = np.geomspace(SOFTEST, STIFFEST, 60)
    unstable = next((i for i, stiffness in enumerate(grid) if growth(loop, stiffness) >= 0.0), None)
    if unstable is None:
        return STIFFEST
    low, high = (grid[unstable - 1], grid[unstable]) if unstable > 0 else (0.0, 0.0)
    while high - low > 1e-3 * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if growth(loop, middle) < 0.0 else (low, middle)
    return float(low)


def check_hand(robot: RobotModel, params: HandGuidingParameters, link: int, p_LC: Array) -> float:
    """Return `max_hand_stiffness` (N/m) for the end effector at home, and warn if the stated hand is stiffer.

    It is that along the direction in which the arm is the lightest, for exact velocities and forces without delay.

    Parameters
    ----------
    link, p_LC : int, (3,) array
        The guided point of the end effector: link, and position in it (m).
    """
    terms, point = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)), params.end_effector
    J = terms.point(link, p_LC).Jv_WC
    arm_mass = 1.0 / float(np.linalg.eigvalsh(J @ np.linalg.solve(terms.M, J.T))[-1])
    mass, damping = (
        float(np.linalg.eigvalsh(positive_definite(getattr(point, name), 3, name))[0]) for name in ("mass", "damping")
    )
    servo = STIFF_SERVO if params.feedback == "commanded" else None
    loop = GuidingLoop(params, mass, damping, arm_mass, params.hand_damping, servo=servo, differentiated=False)
    limit = max_hand_stiffness(loop)
    if params.hand_stiffness > limit:
        hand = f"a hand of {params.hand_stiffness:g} N/m and {params.hand_damping:g} Ns/m"
        message = f"{hand} can oscillate with the end effector: with these gains, and {arm_mass:.2g} kg there at home,"
        warnings.warn(f"{message} the limit is {limit:.0f} N/m", StabilityWarning, stacklevel=3)
    return limit
