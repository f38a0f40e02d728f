"""Parameters of the impedance and of the force control at a contact."""

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
class ContactImpedanceParameters:
    """Impedance at the contact. Gains: the deliverable, unless marked."""

    # N/m, stiffness at the contact along the world's axes; one value or three.
    K_p: list[float] | float = 500.0
    # Ns/m, damping at the contact along the world's axes; one value or three.
    K_d: list[float] | float = 80.0
    # kg, desired inertia along the world's axes; empty: the natural one, eq. (57), which needs no force estimate.
    M_d: list[float] = field(default_factory=list)
    # 1/s, damping of self-motion; one value or one a joint.
    K_N: list[float] | float = 20.0
    # m; the part of the residual that the estimated force does not explain is compensated up to this lever arm times
    # that force, which is what a contact point wrong by as much explains. 0: none, as published. Assumed.
    misfit_lever: float = 0.03
    # Share of the identified friction that is compensated; below 1, lest a joint be driven by a mistake. Assumed.
    friction_share: float = 0.9
    # Nm (N); on the way back the residual, which nobody causes, is cancelled up to this: no more than what a contact is
    # felt by. One value or one a joint. 0: none, as published. Assumed.
    return_torque: list[float] | float = 1.0
    # kg, bound of the effective mass near singular directions of the contact. Assumed.
    max_effective_mass: float = 100.0
    # kg, the same with the natural inertia, which is not shaped: a contact that is heavier moves by self-motion, and
    # K_N damps that. Assumed.
    max_natural_mass: float = 1000.0
    # The natural inertia's damping ratio is at least this in all directions: K_d alone lets a heavy contact swing for
    # seconds. 0: K_d as published. Assumed.
    least_damping: float = 0.7
    # kg; the natural inertia's gains fall with the effective mass of the contact where it is lighter, as a wrist can
    # be: K_d over it stays below half of 1/period. Assumed.
    least_effective_mass: float = 0.8
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        _check_gains(self, "K_p", "K_d")
        require_non_negative(self, "least_damping", "return_torque")
        require_positive(self, "max_natural_mass")


@dataclass
class ContactForceControlParameters:
    """Force at the contact. Gains: the deliverable, unless marked."""

    # "aligned": the desired force points along the estimated one, so that the person always resists it; "fixed": it
    # points in a fixed direction of the world, and the robot drifts where nobody resists.
    direction: str = "aligned"
    # N; size of the aligned desired force.
    desired_force: float = 15.0
    # Largest tangential part of the aligned force over its normal part. Friction in the joints looks like a force that
    # resists; followed without a bound it turns the direction on and on, until the contact slips off. Assumed.
    leaning: float = 0.25
    # N; the fixed desired force in the world.
    fixed_force: list[float] = field(default_factory=lambda: [0.0, 15.0, 0.0])
    # Gain on the force error along the world's axes; one value or three.
    K_f: list[float] | float = 4.1
    # Ns/m, damping at the contact along the world's axes; one value or three.
    K_d: list[float] | float = 10.5
    # kg, desired inertia along the world's axes; empty: the natural one, eq. (57). Chosen equal in all directions, so
    # that the contact moves along the force error; the deliverable does not give it. Assumed.
    M_d: list[float] = field(default_factory=lambda: [10.0, 10.0, 10.0])
    # 1/s, damping of self-motion; one value or one a joint.
    K_N: list[float] | float = 15.0
    # N; the force is controlled once the estimate exceeds the first, and until it falls below the second. Assumed.
    gate_on: float = 3.0
    gate_off: float = 1.5
    # N/s; the aligned force grows at this rate from the estimate at the gate. 0: at once, as published. Assumed.
    force_rate: float = 10.0
    # N; the aligned force exceeds the estimate by no more, lest the robot run after a hand that leaves. Assumed.
    max_deficit: float = 4.0
    # m/s; the force control never moves the contact point faster (a person still can). As in ISO 10218 for guidance.
    speed_limit: float = 0.25
    # A speed that reaches this share of the limit, now or within the next `stop_lead` seconds, stops the robot until it
    # is released: measured velocity is late, and so is the answer to it. Assumed.
    stop_share: float = 0.9
    stop_lead: float = 0.02
    # m; the contact follows a hand that leaves no farther: then nobody is there, and the robot stops as for speed.
    # Assumed.
    follow_limit: float = 0.2
    # N, s, s; an estimate that falls this far below its mean over the first time tells that the hand has left: the
    # robot brakes for the second. Friction of its own motion can look like a force that stays. Assumed.
    drop_limit: float = 6.0
    drop_time: float = 0.1
    leave_time: float = 0.3
    # s; how much later than it is commanded a torque acts; the stop looks ahead farther by as much.
    torque_delay: float = 0.0
    # m; bound of the compensated misfit, as in `ContactImpedanceParameters`. Assumed.
    misfit_lever: float = 0.03
    # Share of the identified friction that is compensated; below 1, lest a joint be driven by a mistake. Assumed.
    friction_share: float = 0.9
    # kg, bound of the effective mass near singular directions of the contact. Assumed.
    max_effective_mass: float = 100.0
    # kg; the natural inertia's gains fall with the effective mass of the contact where it is lighter, as a wrist can
    # be: K_d over it stays below half of 1/period. Assumed.
    least_effective_mass: float = 0.2
    # N/m and Ns/m; the hand that is expected. Stiffness 0: not stated; otherwise `check_hand` warns if it is too stiff.
    hand_stiffness: float = 0.0
    hand_damping: float = 0.0
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        _check_gains(self, "K_f", "K_d")
        require_choice(self, "direction", ("aligned", "fixed"))
        if np.shape(self.fixed_force) != (3,) or not np.all(np.isfinite(self.fixed_force)):
            raise ParameterError("fixed_force", f"needs three finite numbers, got {self.fixed_force}")
        require_positive(self, "desired_force", "gate_on", "gate_off", "max_deficit", "speed_limit", "stop_lead")
        require_positive(self, "follow_limit", "drop_limit", "drop_time")
        require_non_negative(self, "leaning", "leave_time", "torque_delay", "force_rate")
        require_non_negative(self, "hand_stiffness", "hand_damping")
        if not 0.0 < self.stop_share <= 1.0:
            raise ParameterError("stop_share", f"must be above 0 and at most 1, got {self.stop_share}")
        if self.gate_off >= self.gate_on:
            raise ParameterError("gate_off", f"must be below gate_on, {self.gate_on} N, got {self.gate_off}")


def _check_gains(params: ContactImpedanceParameters | ContactForceControlParameters, *names: str) -> None:
    for name in names:
        diagonal(getattr(params, name), 3, name)
    diagonal(params.K_N, np.size(params.K_N), "K_N")
    if len(params.M_d):
        positive_definite(params.M_d, 3, "M_d")
    require_non_negative(params, "misfit_lever", "friction_share", "least_effective_mass")
    require_positive(params, "max_effective_mass", "period")
