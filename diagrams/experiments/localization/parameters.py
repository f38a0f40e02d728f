"""How random scenes of a touched robot are drawn, and the room in which they take place."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_choice, require_non_negative, require_positive
from saphari_drake.perception.camera.model import CameraParameters, back_projected, camera_pose, ray_tables
from saphari_drake.simulation.sensors.depth_noise import DepthNoiseParameters

Depth = NDArray[np.float32]

KINDS = ("finger", "fist", "forearm", "pinch", "palm", "elbow")


@dataclass
class SceneParameters:
    """How scenes are drawn. Ranges are [low, high], uniform. All assumed."""

    # "plain": finger, fist and forearm of the dimensions below; "measured": hands that pinch and press too, tapering
    # arms with elbows, trunk and head, of the 5th to the 95th percentile.
    people: str = "plain"
    # m; deviation of the wrinkles of sleeves (0: none), and about their length.
    sleeve_sigma: float = 0.0
    sleeve_length: float = 0.04
    # Hands of different size that are drawn from (≥ 1), and their dimensions (m).
    hands: int = 6
    finger_radius: list[float] = field(default_factory=lambda: [0.006, 0.012])
    finger_length: list[float] = field(default_factory=lambda: [0.05, 0.08])
    fist_radius: list[float] = field(default_factory=lambda: [0.035, 0.050])
    forearm_radius: list[float] = field(default_factory=lambda: [0.030, 0.045])
    forearm_length: list[float] = field(default_factory=lambda: [0.22, 0.30])
    # rad; largest deviation of each joint from home, and rad/s of each joint while it moves.
    posture: float = 0.8
    speed: float = 0.15
    # m; least distance of the contact point from the other links' surfaces, which would share it.
    margin: float = 0.010
    # N; size of the force, drawn uniformly or in its logarithm, the tangent of its angle to the normal, and the share
    # by which it wanders over frames.
    force: list[float] = field(default_factory=lambda: [10.0, 40.0])
    force_drawn: str = "uniform"
    friction: float = 0.45
    wander: float = 0.15
    # Nm; standard deviation of the residual of each joint, and the share of it that the next frame repeats.
    torque_noise: float = 0.2
    torque_memory: float = 0.2
    # A contact counts as visible if at least so many pixels of the person lie so near to it (m).
    visible_pixels: int = 12
    visible_radius: float = 0.03
    noise: DepthNoiseParameters = field(default_factory=DepthNoiseParameters)

    def __post_init__(self) -> None:
        ranges = ("finger_radius", "finger_length", "fist_radius", "forearm_radius", "forearm_length", "force")
        require_positive(self, *ranges, "hands", "posture", "sleeve_length", "visible_pixels", "visible_radius")
        require_non_negative(self, "speed", "margin", "friction", "wander", "torque_noise", "sleeve_sigma")
        require_choice(self, "people", ("plain", "measured"))
        require_choice(self, "force_drawn", ("uniform", "logarithm"))
        for name in ranges:
            value = getattr(self, name)
            if len(value) != 2 or value[0] > value[1]:
                raise ParameterError(name, f"needs [low, high], got {value}")
        if not 0.0 <= self.torque_memory < 1.0:
            raise ParameterError("torque_memory", f"must lie in 0–1, got {self.torque_memory}")


def room_depth(camera: CameraParameters, half_width: float = 2.4) -> Depth:
    """Return the depth (m) of an empty room with the floor at z = 0 and walls at ± `half_width` (m)."""
    X_WC = camera_pose(camera)
    x, y = ray_tables(camera)
    rays = back_projected(x, y, np.ones((len(y), len(x)))) @ X_WC.rotation().matrix().T
    p = X_WC.translation()
    with np.errstate(divide="ignore", invalid="ignore"):
        planes = [-p[2] / rays[..., 2], *((np.sign(rays[..., i]) * half_width - p[i]) / rays[..., i] for i in range(2))]
    depth = np.min([np.where(t > 0.0, t, np.inf) for t in planes], axis=0)
    return np.where(depth > camera.far, np.inf, depth).astype(np.float32)
