"""Parameters of the contact force control."""

from dataclasses import dataclass, field

import numpy as np

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import (
    diagonal,
    positive_definite,
    require_choice,
    require_non_negative,
    require_positive,
)


@dataclass
class ContactForceControlParameters:
    """Force at the contact, and the behaviour without one. Gains: the deliverable, unless marked."""

    # "aligned": the desired force points along the estimated one, so that the person always resists it; "fixed": it
    # points in a fixed direction of the world, and the robot drifts where nobody resists.
    direction: str = "aligned"
    # N; size of the aligned desired force.
    desired_force: float = 15.0
    # N; the fixed desired force in the world.
    fixed_force: list[float] = field(default_factory=lambda: [0.0, 15.0, 0.0])
    # Gain on the force error along the world's axes; one value or three.
    K_f: list[float] | float = 4.1
    # Ns/m, damping at the contact along the world's axes; one value or three.
    K_d: list[float] | float = 10.5
    # kg, desired inertia along the world's axes; empty: the natural one, eq. (57). Chosen equal in all directions, so
    # that the contact moves along the force error; the deliverable does not give it. A.
    M_d: list[float] = field(default_factory=lambda: [10.0, 10.0, 10.0])
    # 1/s, damping of self-motion; one value or one a joint.
    K_N: list[float] | float = 15.0
    # N; the force is controlled once the estimate exceeds the first, and until it falls below the second. A.
    gate_on: float = 3.0
    gate_off: float = 1.5
    # N/s; the aligned force grows at this rate from the estimate at the gate. 0: at once, as in the deliverable. A.
    force_rate: float = 10.0
    # N; the aligned force exceeds the estimate by no more, so that the robot does not run after a hand that leaves. A.
    max_deficit: float = 4.0
    # m/s; the force control never moves the contact point faster (a person still can). As in ISO 10218 for guidance.
    speed_limit: float = 0.25
    # A speed that reaches this share of the limit, now or within the next `stop_lead` seconds, stops the robot until it
    # is released: measured velocity is late, and so is the answer to it. A.
    stop_share: float = 0.9
    stop_lead: float = 0.02
    # m; bound of the compensated misfit, as in `ContactImpedanceParameters`. A.
    misfit_lever: float = 0.03
    # 1/s², stiffness over inertia of the held posture; one value or one a joint. A.
    hold_stiffness: list[float] | float = 225.0
    # 1/s, damping over inertia of the held posture, and while braking. A.
    hold_damping: list[float] | float = 30.0
    # 1/s, damping over inertia while yielding, or without a camera. A.
    yield_damping: list[float] | float = 10.0
    # s, time constant with which the torque of the law that was left fades; the second holds while braking. A.
    transition_time: float = 0.1
    brake_time: float = 0.01
    # kg, bound of the effective mass near singular directions of the contact. A.
    max_effective_mass: float = 50.0
    # N/m and Ns/m; the hand that is expected. Stiffness 0: not stated; otherwise `check_hand` warns if it is too stiff.
    hand_stiffness: float = 0.0
    hand_damping: float = 0.0
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        require_choice(self, "direction", ("aligned", "fixed"))
        for name in ("K_f", "K_d"):
            diagonal(getattr(self, name), 3, name)
        for name in ("K_N", "hold_stiffness", "hold_damping", "yield_damping"):
            value = getattr(self, name)
            diagonal(value, np.size(value), name)
        if len(self.M_d):
            positive_definite(self.M_d, 3, "M_d")
        if np.shape(self.fixed_force) != (3,) or not np.all(np.isfinite(self.fixed_force)):
            raise ParameterError("fixed_force", f"needs three finite numbers, got {self.fixed_force}")
        require_positive(self, "desired_force", "gate_on", "gate_off", "max_deficit", "speed_limit", "stop_lead")
        require_positive(self, "transition_time", "brake_time", "max_effective_mass", "period")
        require_non_negative(self, "force_rate", "misfit_lever", "hand_stiffness", "hand_damping")
        if not 0.0 < self.stop_share <= 1.0:
            raise ParameterError("stop_share", f"must be above 0 and at most 1, got {self.stop_share}")
        if self.gate_off >= self.gate_on:
            raise ParameterError("gate_off", f"must be below gate_on, {self.gate_on} N, got {self.gate_off}")
