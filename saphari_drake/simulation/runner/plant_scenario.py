"""What the scenarios of all experiments with a simulated robot have in common: its plant."""

from dataclasses import dataclass, field

from saphari_drake.parameters import require_choice
from saphari_drake.simulation.world.profile import PLANTS, PlantProfile, Truth, profile_of, realistic


@dataclass
class PlantScenario:
    """A robot, and how its plant differs from what its controllers know."""

    case: str = ""
    # Seed of everything random.
    seed: int = 0
    # s.
    duration: float = 1.0
    # Catalog name, or path of a URDF or SDF.
    robot: str = "lwr4"
    # The plant: ideal, or realistic with the numbers below.
    plant: str = "ideal"
    realistic: PlantProfile = field(default_factory=realistic)

    def __post_init__(self) -> None:
        require_choice(self, "plant", PLANTS)

    def truth(self, period: float) -> Truth:
        """Return what is true of the robot, for controllers with a cycle of `period` (s)."""
        return Truth(profile_of(self.plant, self.realistic), self.seed, period)
