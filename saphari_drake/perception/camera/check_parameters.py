"""The numbers of the camera self-check, and what it may find."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive


@dataclass
class CameraCheckParameters:
    """Numbers of the camera self-check."""

    # Displacement of the robot in the image above which the camera's pose is doubted (m, > 0).
    warning: float = 0.005
    # Distance from the model within which a reading belongs to the robot, at first and in the end (m, > 0). The latter
    # is some four deviations of a Kinect's readings.
    reach: float = 0.04
    least_reach: float = 0.015
    # Spacing of the pixels that are used (pixels, ≥ 1), least number of readings for an answer (≥ 6), and how many of a
    # posture are used at most (≥ 1).
    stride: int = 4
    least_points: int = 100
    most_points: int = 400
    # Largest angle between surface and view for a reading to count (cosine of it, 0–1): grazing ones are biased.
    least_cosine: float = 0.4
    # Distance from the person within which a reading does not count (m, > 0).
    person_distance: float = 0.15
    # Rounds of the registration (≥ 1).
    iterations: int = 40
    # Deviation of a reading from the model's surface (m, > 0; a Kinect's noise), and how many of a posture count as
    # independent (> 0): errors of neighbours, and of the model's surface, are alike. Assumed.
    sigma: float = 0.004
    independent: float = 60.0
    # Deviations of the camera's turn and shift that are expected beforehand (rad and m, > 0): those of a camera that
    # was calibrated and may have been pushed. A direction about which the readings tell less than `least_information`
    # times as much as this (≥ 0) is not corrected.
    turn_prior: float = 0.017
    shift_prior: float = 0.02
    least_information: float = 4.0
    # Largest turn and shift of the camera that are corrected (rad and m, > 0); beyond, somebody has to look at it.
    most_turn: float = 0.05
    most_shift: float = 0.05

    def __post_init__(self) -> None:
        require_positive(
            self, "warning", "reach", "least_reach", "stride", "least_points", "most_points", "least_cosine",
            "person_distance", "iterations", "sigma", "independent", "turn_prior", "shift_prior",
            "most_turn", "most_shift",
        )  # fmt: skip
        require_non_negative(self, "least_information")
        if self.least_points < 6:
            raise ParameterError("least_points", f"must be at least 6, got {self.least_points}")
        if self.least_cosine > 1.0:
            raise ParameterError("least_cosine", f"must not exceed 1, got {self.least_cosine}")
        if self.least_reach > self.reach:
            raise ParameterError("least_reach", f"must not exceed reach ({self.reach} m), got {self.least_reach}")

    def prior(self) -> NDArray[np.float64]:
        """Return the covariance (6, 6) of turn (rad) and shift (m) that is expected beforehand."""
        return np.diag(np.repeat([self.turn_prior**2, self.shift_prior**2], 3))


class CheckStatus(IntEnum):
    """What the self-check found, also as a number."""

    UNKNOWN = 0  # too little of the robot is seen
    OK = 1
    WARNING = 2  # the camera is displaced by more than allowed; the correction takes it into account
    BUSY = 3  # a person hides too much of the robot: nothing is compared, and the last error stands
    BEYOND = 4  # the camera is displaced by more than may be corrected
