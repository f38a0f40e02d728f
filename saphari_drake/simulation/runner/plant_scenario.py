"""What the scenarios of all experiments with a simulated robot have in common: its plant, and its faults."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.momentum_observer import MomentumObserverParameters
from saphari_drake.parameters import require_choice
from saphari_drake.robots.arm_file import load_arm
from saphari_drake.robots.attached import ModelOptions
from saphari_drake.robots.corrections import RobotCorrections, corrected
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.registry import FAULTS, STATIC, FaultSizes, require_faults
from saphari_drake.simulation.world.profile import PLANTS, PlantProfile, Truth, profile_of, realistic


@dataclass
class PlantScenario:
    """A robot, how its plant differs from what its controllers know, and what fails."""

    case: str = ""
    # Seed of everything random.
    seed: int = 0
    # s.
    duration: float = 1.0
    # Catalog name, or path of a URDF, SDF or MJCF; and what is known of it beside that file.
    robot: str = "lwr4"
    model: ModelOptions = field(default_factory=ModelOptions)
    # The plant: ideal, or realistic with the numbers below.
    plant: str = "ideal"
    realistic: PlantProfile = field(default_factory=realistic)
    # File of `diagrams/identify.py`: what the controllers know of the robot beyond its model file. Empty: nothing.
    identified: str = ""
    # Names of faults; --help lists them. When they begin (s; negative: drawn from the seed), and how large they are.
    faults: list[str] = field(default_factory=list)
    fault_time: float = -1.0
    fault_sizes: FaultSizes = field(default_factory=FaultSizes)

    def __post_init__(self) -> None:
        require_choice(self, "plant", PLANTS)
        require_faults(self.faults, {fault.part for fault in FAULTS.values()})
        if not np.isfinite(self.fault_time):
            raise ParameterError("fault_time", f"must be finite, got {self.fault_time}")

    def loaded(self, home: ArrayLike = ()) -> RobotModel:
        """Return the robot as its file (`load_arm`) and `model` have it; `home` in deg (m), empty: its own."""
        return load_arm(self.robot, home=np.deg2rad(home), options=self.model)

    def known(self, robot: RobotModel, observer: MomentumObserverParameters | None = None) -> RobotModel:
        """Return the robot as its controllers know it, and tell an observer friction and bias."""
        if not self.identified:
            return robot
        found = RobotCorrections.read(self.identified)
        if observer is not None:
            friction = observer.friction
            friction.coulomb, friction.viscous, friction.bias = found.coulomb or 0.0, found.viscous, found.bias
        return corrected(robot, found)

    def fault_start(self) -> float:
        """Return when the faults begin that are not there from the beginning (s)."""
        if self.fault_time >= 0.0:
            return self.fault_time
        return self.duration * float(np.random.default_rng([self.seed, 9]).uniform(0.2, 0.6))

    def truth(self, period: float) -> Truth:
        """Return what is true of the robot, for controllers with a cycle of `period` (s)."""
        faults = {name: 0.0 if name in STATIC else self.fault_start() for name in self.faults}
        profile, sizes = profile_of(self.plant, self.realistic), self.fault_sizes
        if "payload" in faults:
            profile = replace(profile, payload=profile.payload + sizes.payload)
        if "model_error" in faults:
            profile = replace(profile, mass_error=sizes.model_error)
        if "friction_double" in faults:
            viscous, coulomb = 2.0 * self.realistic.viscous, 2.0 * self.realistic.coulomb
            profile = replace(profile, viscous=viscous, coulomb=coulomb)
        return Truth(profile, self.seed, period, faults, sizes)
