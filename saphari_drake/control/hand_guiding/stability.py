"""How stiff a hand may be before hand guiding oscillates with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.parameters import require_non_negative, require_positive

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GuidingLoop:
    """What is in the loop between the hand and the motion of a guided point, along one axis.

    Attributes
    ----------
    params : HandGuidingParameters
        Period and gains of the controller.
    arm_mass : float
        Effective mass of the arm at the point (kg).
    hand_damping : float
        Of the hand (Ns/m).
    force_lag : float
        Time constant of the force sensor's filter (s).
    force_delay : int
        Whole cycles from the measurement of the force to its use.
    servo : (float, float) or None
        Stiffness (1/s²) and damping (1/s) of an arm that takes positions; None: it takes torques.
    differentiated : bool
        Whether velocity is measured as the difference of two positions.
    """

    params: HandGuidingParameters = field(default_factory=HandGuidingParameters)
    arm_mass: float = 3.0
    hand_damping: float = 0.0
    force_lag: float = 0.0
    force_delay: int = 0
    servo: tuple[float, float] | None = None
    differentiated: bool = True

    def __post_init__(self) -> None:
        require_positive(self, "arm_mass")
        require_non_negative(self, "hand_damping", "force_lag", "force_delay")


def transition_matrix(loop: GuidingLoop, mass: float, damping: float, stiffness: float) -> Array:
    """Return the matrix that takes the loop from one control cycle to the next.

    Along one axis the law (47)–(50) is linear. The state is position and velocity of the point, the position of the
    cycle before, commanded and desired position and velocity, the force that is fed forward, the filtered one and those
    under way to the controller.

    Parameters
    ----------
    loop : GuidingLoop
    mass, damping : float
        M_c (kg) and D_c (Ns/m).
    stiffness : float
        Of the hand, F = −k x − d ẋ (N/m).
    """
    p = loop.params
    T, m, k, d = p.period, loop.arm_mass, stiffness, loop.hand_damping
    commanded = p.feedback == "commanded" or loop.servo is not None
    share = T * damping / (mass + T * damping)
    filtering, smoothing = (math.exp(-T / time) if time > 0.0 else 0.0 for time in (loop.force_lag, p.force_time))
    size = 9 + loop.force_delay
    A = np.zeros((size, size))
    for column in range(size):
        unit = np.zeros(size)
        unit[column] = 1.0
        x, v, before, x_c, v_c, p_d, v_d, fed, filtered, *queue = unit
        force = filtering * filtered + (1.0 - filtering) * (-k * x - d * v)
        queue = [force, *queue]
        used = queue.pop()
        fed = smoothing * fed + (1.0 - smoothing) * used
        v_m = (x - before) / T if loop.differentiated else v
        v_d_next = v_d + share * (used / damping - v_d)
        x_a, v_a = (x_c, v_c) if commanded else (x, v_m)
        a = (v_d_next - v_d) / T + p.k_d * (v_d - v_a) + p.k_p * (p_d - x_a)
        v_c_next = v_c + T * a
        x_c_next = x_c + 0.5 * T * (v_c + v_c_next)
        if loop.servo is None:
            push = m * (a + p.K_D * (v_c - v_m) + p.K_P * (x_c - x)) - fed
            state = _move(x, v, (k / m, d / m), push / m, T)
        else:
            K, D = loop.servo
            state = _move(x, v, (K + k / m, D + d / m), K * x_c_next + D * v_c_next, T)
        A[:, column] = [*state, x, x_c_next, v_c_next, p_d + 0.5 * T * (v_d + v_d_next), v_d_next, fed, force, *queue]
    return A


def _move(x: float, v: float, spring: tuple[float, float], drive: float, T: float) -> tuple[float, float]:
    """Return x, v after T with ẍ = −a x − b ẋ + drive, exactly (a > 0)."""
    a, b = spring
    rest = drive / a
    x, half = x - rest, 0.5 * b
    root = np.sqrt(complex(half * half - a))
    if abs(root) * T < 1e-6:
        grow, decay = math.exp(-half * T), (v + half * x)
        return rest + grow * (x + decay * T), grow * (v - half * decay * T)
    cosh, sinh = np.cosh(root * T), np.sinh(root * T) / root
    grow = math.exp(-half * T)
    return (
        rest + grow * float((cosh * x + sinh * (v + half * x)).real),
        grow * float((cosh * v - sinh * (a * x + half * v)).real),
    )


def growth(loop: GuidingLoop, mass: float, damping: float, stiffness: float) -> float:
    """Return the rate of growth of the slowest mode (1/s): negative if hand and robot come to rest together."""
    radius = float(np.abs(np.linalg.eigvals(transition_matrix(loop, mass, damping, stiffness))).max())
    return math.log(radius) / loop.params.period


def max_hand_stiffness(
    loop: GuidingLoop, mass: float, damping: float, softest: float = 50.0, stiffest: float = 1e5
) -> float:
    """Return the hand stiffness (N/m) up to which hand and robot are stable together; `stiffest` if all are.

    Found by bisection on `growth` between the first unstable of 60 stiffnesses and the one before it; 0 if the softest
    is unstable already.
    """
    grid = np.geomspace(softest, stiffest, 60)
    before = 0.0
    for k in grid:
        if growth(loop, mass, damping, k) >= 0.0:
            break
        before = float(k)
    else:
        return stiffest
    if before == 0.0:
        return 0.0
    high = float(k)
    while high - before > 1e-3 * before:
        middle = 0.5 * (before + high)
        if growth(loop, mass, damping, middle) < 0.0:
            before = middle
        else:
            high = middle
    return before


def stiffness_table(
    loop: GuidingLoop, masses: Sequence[float], dampings: Sequence[float], arm_masses: Sequence[float]
) -> Array:
    """Return `max_hand_stiffness` for each mass (row) and damping (column), the least over effective masses (N/m)."""
    table = np.full((len(masses), len(dampings)), np.inf)
    for arm_mass in arm_masses:
        own = GuidingLoop(**{**vars(loop), "arm_mass": arm_mass})
        for i, mass in enumerate(masses):
            for j, damping in enumerate(dampings):
                table[i, j] = min(table[i, j], max_hand_stiffness(own, mass, damping))
    return table
