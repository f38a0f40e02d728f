"""Forces of the touches in a scene, and what disturbs the residual."""

import numpy as np
from numpy.typing import NDArray

from experiments.localization.parameters import SceneParameters
from experiments.localization.scenes import DrawnTouch

Array = NDArray[np.float64]


def wandering_forces(rng: np.random.Generator, touch: DrawnTouch, frames: int, p: SceneParameters) -> Array:
    """Return the force on the robot in each frame, (frames, 3) N, in the link's frame; it wanders in its cone."""
    inward = -touch.n_L
    low, high = p.force
    size = rng.uniform(low, high) if p.force_drawn == "uniform" else np.exp(rng.uniform(np.log(low), np.log(high)))
    tilt = p.friction * np.sqrt(rng.random())
    side = np.cross(inward, rng.normal(size=3))
    side /= np.linalg.norm(side)
    result, drift = np.zeros((frames, 3)), np.zeros(3)
    for k in range(frames):
        if k > 0:
            drift = 0.8 * drift + 0.6 * p.wander * rng.normal(size=3)
        tangent = tilt * side + drift - (drift @ inward) * inward
        tangent *= min(1.0, p.friction / max(float(np.linalg.norm(tangent)), 1e-9))
        result[k] = size * (1.0 + drift @ inward) * (inward + tangent) / np.sqrt(1.0 + tilt**2)
    return result


def torque_noise(rng: np.random.Generator, joints: int, frames: int, p: SceneParameters) -> Array:
    """Return the error of the residual in each frame, (frames, joints) Nm."""
    noise = rng.normal(size=(frames, joints)) * p.torque_noise
    for k in range(1, frames):
        noise[k] = p.torque_memory * noise[k - 1] + np.sqrt(1.0 - p.torque_memory**2) * noise[k]
    return noise
