"""What the protective separation distance is made of."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive


@dataclass
class SpeedSeparationParameters:
    """Terms of the protective separation distance of ISO/TS 15066, 5.5.4, now in ISO 10218-2:2025."""

    # m/s, fastest that people come nearer. ISO 13855: 1.6 walking, 2.0 with a hand.
    person_speed: float = 1.6
    # m/s², with which they change the speed that is seen; infinite: they may have `person_speed` at once.
    person_acceleration: float = np.inf
    # s, T_r, from what happens to the begin of the stop, beside the age of what the cameras say. Assumed.
    reaction_time: float = 0.02
    # m, C, by which a part of the body reaches in before it is seen. Assumed: cameras see hands.
    intrusion: float = 0.0
    # m, Z_d and Z_r, errors of people's and of the robot's positions. Assumed.
    person_error: float = 0.02
    robot_error: float = 0.005
    # s; people seen longer ago than this count as lost.
    people_timeout: float = 0.2

    def __post_init__(self) -> None:
        require_positive(self, "people_timeout")
        require_non_negative(self, "person_speed", "reaction_time", "intrusion", "person_error", "robot_error")
        if not self.person_acceleration > 0.0:
            raise ParameterError("person_acceleration", f"must be positive, got {self.person_acceleration}")

    def rule(self, age: float) -> "Rule":
        """Return the terms for people that were seen `age` (s) ago."""
        kept = self.intrusion + self.person_error + self.robot_error
        return Rule(self.person_speed, self.person_acceleration, self.reaction_time + max(age, 0.0), kept)


class Rule(NamedTuple):
    """The terms, as the law takes them."""

    person_speed: float  # m/s
    acceleration: float  # m/s²
    reaction: float  # s, T_r with the age of what was seen
    kept: float  # m, C + Z_d + Z_r
