"""How stiff a hand may be before force control oscillates with it."""

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.errors import StabilityWarning

Array = NDArray[np.float64]


def max_hand_stiffness(
    K_d: float,
    K_f: float,
    K_I: float,
    desired_mass: float = math.inf,
    natural_mass: float | None = None,
    hand_damping: float = 0.0,
    delay: float = 0.0,
) -> float:
    """Return the stiffness (N/m) up to which a hand and the force control are stable together; inf without a limit.

    Along one axis the robot of effective mass Λ is driven so that, with x the contact and F the hand's force,

        M_d ẍ = K_f F̂ − K_d ẋ + μ (F − F̂),   μ = M_d/Λ,   F = −(k x + d ẋ),   F̂ = F/(1 + s/K_I):

    the estimate F̂ is the residual, a first-order lag behind F, and the robot feels the difference of both. Hence

        M_d s³ + a s² + (K_I (K_d + K_f d) + μ k) s + K_f K_I k = 0,   a = M_d K_I + K_d + μ d,

    which is stable (Routh–Hurwitz) while a (K_I (K_d + K_f d) + μ k) > M_d K_f K_I k, or

        k < K_I (K_d + K_f d) a / (M_d K_f K_I − μ a).

    For the natural inertia (μ = 1), no hand damping and a heavy contact this is K_d K_I/(K_f − 1). A hand of 20 Ns/m
    raises it tenfold. A desired inertia above K_f times the natural one has no limit.

    Parameters
    ----------
    K_d, K_f : float
        Damping (Ns/m) and force gain of the controller.
    K_I : float
        Gain of the momentum observer (1/s).
    desired_mass : float
        M_d (kg); the default is the limit of a heavy contact.
    natural_mass : float, optional
        Λ (kg); default: the desired one, M_d = Λ.
    hand_damping : float
        d (Ns/m).
    delay : float
        Delay of the loop (s), such as half a control cycle for the torque that is held; added to the lag 1/K_I.
    """
    K_I = 1.0 / (1.0 / K_I + delay)
    feedback = K_I * (K_d + K_f * hand_damping)
    if math.isinf(desired_mass):
        mu = 1.0 if natural_mass is None or math.isinf(natural_mass) else math.inf
        return feedback / (K_f - mu) if mu < K_f else math.inf
    mu = 1.0 if natural_mass is None else desired_mass / natural_mass
    a = desired_mass * K_I + K_d + mu * hand_damping
    left = desired_mass * K_f * K_I - mu * a
    return feedback * a / left if left > 0.0 else math.inf


def hand_stiffness_limits(params: ContactForceControlParameters, observer_gain: float) -> Array:
    """Return `max_hand_stiffness` along the world's axes (3,) for a hand with the stated damping (N/m).

    They hold for the contact that is the least stable: the heaviest that the controller reckons with.

    Parameters
    ----------
    params :
        Parameters of the controller.
    observer_gain : float
        K_I (1/s), the smallest of all joints.
    """
    heavy = params.max_effective_mass
    gains = (np.broadcast_to(value, 3) for value in (params.K_d, params.K_f, params.M_d or heavy))
    delay = 0.5 * params.period
    return np.array(
        [
            max_hand_stiffness(K_d, K_f, observer_gain, mass, heavy, params.hand_damping, delay)
            for K_d, K_f, mass in zip(*gains)
        ]
    )


def check_hand(params: ContactForceControlParameters, observer_gain: float) -> list[str]:
    """Warn if the stated hand is stiffer than `hand_stiffness_limits`; return the warnings, empty if all is well.

    Nothing is checked if the hand's stiffness is not stated.
    """
    if params.hand_stiffness == 0.0:
        return []
    messages = [
        f"a hand of {params.hand_stiffness:g} N/m and {params.hand_damping:g} Ns/m can oscillate along {axis}: with "
        f"these gains and an observer gain of {observer_gain:g} 1/s the limit is {limit:.0f} N/m"
        for axis, limit in zip("XYZ", hand_stiffness_limits(params, observer_gain))
        if params.hand_stiffness > limit
    ]
    for message in messages:
        warnings.warn(message, StabilityWarning, stacklevel=2)
    return messages
