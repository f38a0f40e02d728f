"""Parameters of the null-space compliance."""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_choice, require_non_negative, require_positive


class Observer(IntEnum):
    """Which estimate of the external torque keeps the task; by its name in lower case a value of `observer`."""

    NONE = 0
    TASK_ERROR = 1  # Proposition 1
    TASK_ERROR_PD = 2  # Proposition 2
    MOMENTUM = 3  # Proposition 3


OBSERVERS = tuple(observer.name.lower() for observer in Observer)
TASKS = {"position": 3, "pose": 6}


@dataclass
class NullSpaceComplianceParameters:
    """Task, observer and gains. All gains A; one value or three, for position, and the same for rotation."""

    # Which estimate of the external torque keeps the task: none, task_error (Proposition 1), task_error_pd
    # (Proposition 2) or momentum (Proposition 3).
    observer: str = "momentum"
    # What is controlled: position (m = 3), or pose (m = 6).
    task: str = "position"
    # Frame that is controlled; empty: that of the last link.
    frame: str = ""
    # 1/s; ratio of stiffness to damping, Proposition 1.
    P: list[float] | float = 10.0
    # Ns/m and Nms/rad; damping, Proposition 1.
    K: list[float] | float = 180.0
    K_rotation: list[float] | float = 4.0
    # Ns/m and Nms/rad; damping, Proposition 2 and no observer.
    D: list[float] | float = 180.0
    D_rotation: list[float] | float = 4.0
    # N/m and Nm/rad; stiffness, Proposition 2 and no observer. One value for rotation, as its proof needs.
    K_x: list[float] | float = 1800.0
    K_x_rotation: float = 20.0
    # 1/s; weight of the error in the observer, Proposition 2; checked against `gamma_bound`.
    gamma: float = 0.5
    # m/rad; length at which a rotation counts like a distance, Proposition 2.
    rotation_length: float = 0.1
    # rad; the postures around the home posture for which gamma is checked.
    gamma_region: float = 0.2
    # 1/s and 1/s²; damping and stiffness over inertia, Proposition 3.
    K_v: list[float] | float = 25.0
    K_p: list[float] | float = 150.0
    # Nm/rad and Nms/rad (N/m, Ns/m for prismatic joints); impedance of the body; one value or one a joint.
    null_stiffness: list[float] | float = field(default_factory=lambda: [10.0, 10.0, 10.0, 10.0, 5.0, 5.0, 2.0])
    null_damping: list[float] | float = field(default_factory=lambda: [8.0, 8.0, 5.0, 5.0, 2.0, 1.0, 0.5])
    # Nm; largest external joint torque, by the residual, for which the task is kept; .inf: always.
    torque_threshold: float = 50.0
    # Nm; the task yields fully this far above the threshold.
    threshold_band: float = 10.0
    # s; time constant with which the task begins and ceases to yield.
    yield_time: float = 0.1
    # 1/s; damping over inertia of a task that yields.
    yield_damping: float = 25.0
    # m/s and rad/s; how fast the frame is led back after it has yielded.
    return_speed: float = 0.25
    return_turn: float = 1.0
    # kg and kg m²; bound of the effective inertia near singularities.
    max_effective_mass: float = 50.0
    max_effective_inertia: float = 5.0
    # s; the control cycle.
    period: float = 0.002

    def __post_init__(self) -> None:
        require_choice(self, "observer", OBSERVERS)
        require_choice(self, "task", tuple(TASKS))
        for name in ("P", "K", "K_rotation", "D", "D_rotation", "K_x", "K_x_rotation", "K_v", "K_p"):
            require_positive(self, name)
            if np.size(getattr(self, name)) not in ((1,) if name == "K_x_rotation" else (1, 3)):
                raise ParameterError(name, f"needs one value or three, got {getattr(self, name)}")
        require_positive(
            self, "gamma", "rotation_length", "null_stiffness", "null_damping", "threshold_band", "yield_time",
            "yield_damping", "return_speed", "return_turn", "max_effective_mass", "max_effective_inertia", "period",
        )  # fmt: skip
        require_non_negative(self, "gamma_region")
        if not self.torque_threshold > 0.0:
            raise ParameterError("torque_threshold", f"must be positive, got {self.torque_threshold}")
