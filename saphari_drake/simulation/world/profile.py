"""Profiles of the simulated plant: how it differs from what its controllers know."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.math.tree import REVOLUTE
from saphari_drake.parameters import require_non_negative
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.registry import FaultSizes
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters

Array = NDArray[np.float64]
TYPICAL_TORQUE = 100.0  # Nm; a prismatic joint takes the values below times its force limit (N) over this. Assumed


@dataclass
class PlantProfile:
    """What the controllers do not know of the simulated robot. As it stands: nothing; `realistic` has numbers.

    Signs and shares are drawn for each joint and link from the seed of the scenario.
    """

    # Share (0–1) by which the reflected inertia of each motor is off, up or down.
    rotor_error: float = 0.0
    # Largest share (0–1) by which mass and inertia of each link are off together.
    mass_error: float = 0.0
    # kg; payload that the controllers do not know, 5 cm before the last link's frame.
    payload: float = 0.0
    # Nms/rad (Ns/m) and Nm (N); viscous and Coulomb friction of each joint that the torque loop leaves.
    viscous: float = 0.0
    coulomb: float = 0.0
    # Nm (N); standard deviation of the torque's noise, new at each step of the plant.
    torque_noise: float = 0.0
    # Nm (N); constant error of each joint's torque, up or down, and amplitude of its ripple over the joint's position.
    torque_bias: float = 0.0
    torque_ripple: float = 0.0
    # Waves of the ripple on a turn (or a metre).
    ripple_waves: float = 32.0
    # Control cycles from a command to its torque.
    torque_delay: int = 0
    # Bits of an encoder on a turn (or a metre), whose velocity is the difference of two readings; 0: the experiment's
    # own sensor.
    encoder_bits: int = 0
    # s; from taking a camera's frame to its delivery; 0: the experiment's own.
    camera_latency: float = 0.0

    def __post_init__(self) -> None:
        require_non_negative(
            self, "rotor_error", "mass_error", "payload", "viscous", "coulomb", "torque_noise", "torque_bias",
            "torque_ripple", "ripple_waves", "torque_delay", "encoder_bits", "camera_latency",
        )  # fmt: skip
        for name in ("rotor_error", "mass_error"):
            if getattr(self, name) >= 1.0:
                raise ParameterError(name, f"must lie below 1, got {getattr(self, name)}")


def realistic() -> PlantProfile:
    """Return the profile of a plant nearer to a real arm. All numbers are assumed."""
    return PlantProfile(
        rotor_error=0.2, mass_error=0.05, payload=0.2, viscous=1.0, coulomb=0.3, torque_noise=0.05, torque_bias=0.2,
        torque_ripple=0.2, torque_delay=1, encoder_bits=16, camera_latency=0.03,
    )  # fmt: skip


PLANTS = ("ideal", "realistic")


def profile_of(plant: str, numbers: PlantProfile) -> PlantProfile:
    """Return `numbers` for the plant "realistic", and none for "ideal"."""
    return numbers if plant == "realistic" else PlantProfile()


@dataclass(frozen=True)
class Truth:
    """What is true of one simulated robot, drawn from a profile by a seed; ideal as it stands.

    Attributes
    ----------
    profile : PlantProfile
    seed : int
    period : float
        The control cycle (s), in which delays count.
    faults : mapping from str to float
        Faults by name, and when each begins (s).
    sizes : FaultSizes
    """

    profile: PlantProfile = field(default_factory=PlantProfile)
    seed: int = 0
    period: float = 0.001
    faults: Mapping[str, float] = field(default_factory=dict)
    sizes: FaultSizes = field(default_factory=FaultSizes)

    def rotor_scale(self, robot: RobotModel) -> Array:
        """Return reflected inertia over what the controllers know, (n,)."""
        return 1.0 + self.profile.rotor_error * self._signs(robot, 1)

    def mass_scale(self, robot: RobotModel) -> Array:
        """Return mass and inertia of each link over what the controllers know, (n,)."""
        return 1.0 + self.profile.mass_error * np.random.default_rng([self.seed, 2]).uniform(-1.0, 1.0, robot.n)

    def torque_bias(self, robot: RobotModel) -> Array:
        """Return the constant error of the torques, (n,) (Nm or N)."""
        return self.profile.torque_bias * self._signs(robot, 3) * joint_scale(robot)

    def ripple_phase(self, robot: RobotModel) -> Array:
        """Return the phase of the ripple at zero position, (n,) (rad)."""
        return np.random.default_rng([self.seed, 4]).uniform(0.0, 2.0 * np.pi, robot.n)

    def joint_sensor(self, params: JointSensorParameters) -> JointSensorParameters:
        """Return a joint sensor with this robot's encoders."""
        bits = self.profile.encoder_bits
        if bits == 0:
            return params
        return replace(params, position_resolution=2.0 * np.pi / 2.0**bits, differentiate=True)

    def sampler(self, params: Any) -> Any:
        """Return `SamplerParameters` with the latency of this robot's cameras."""
        latency = self.profile.camera_latency
        return replace(params, latency=latency) if latency > 0.0 else params

    def joint(self, robot: RobotModel) -> int:
        """Return the joint that a fault of one joint strikes."""
        return int(np.random.default_rng([self.seed, 10]).integers(robot.n))

    def _signs(self, robot: RobotModel, stream: int) -> Array:
        return np.random.default_rng([self.seed, stream]).choice([-1.0, 1.0], robot.n)


def joint_scale(robot: RobotModel) -> Array:
    """Return what a joint takes of values in Nm: 1 where it is revolute, the force limit over 100 N where prismatic."""
    return np.where(robot.tree.kind == REVOLUTE, 1.0, robot.tau_max / TYPICAL_TORQUE)
