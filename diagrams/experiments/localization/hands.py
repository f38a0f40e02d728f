"""The hands that touch the robot in random scenes: their sizes, their shapes, and how they lie at a contact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Capsule, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from experiments.localization.parameters import SceneParameters

Array = NDArray[np.float64]


class Hands:
    """Hands of several sizes; z of a hand points away from the contact, its origin is the tip of what touches.

    Parameters
    ----------
    params : SceneParameters
    rng : Generator
        Draws the sizes: of each hand finger radius and length, fist radius, forearm radius and length (m).
    """

    def __init__(self, params: SceneParameters, rng: np.random.Generator) -> None:
        names = ("finger_radius", "finger_length", "fist_radius", "forearm_radius", "forearm_length")
        self.sizes = np.array([[rng.uniform(*getattr(params, name)) for name in names] for _ in range(params.hands)])

    def parts(self, kind: str, hand: int) -> list[tuple[Shape, float, str]]:
        """Return the shapes of a hand, each with its centre along z (m) and its name."""
        finger, length, fist, arm, arm_length = self.sizes[hand]
        start = length if kind == "finger" else 0.0
        parts: list[tuple[Shape, float, str]] = [
            (Sphere(fist), start + fist, "fist"),
            (Capsule(arm, arm_length), start + fist + arm_length / 2, "arm"),
        ]
        if kind == "finger":
            straight = length + fist - finger
            parts.append((Capsule(finger, straight), finger + straight / 2, "finger"))
        return parts

    def pose(self, rng: np.random.Generator, kind: str, hand: int, p: Array, n: Array) -> RigidTransform:
        """Return a random pose of a hand that touches a surface at p with outward normal n (3,), in the world."""
        finger, _, fist, arm, arm_length = self.sizes[hand]
        if kind == "forearm":  # its side touches somewhere along its length
            z = np.cross(n, rng.normal(size=3))
            z /= np.linalg.norm(z)
            origin = p + arm * n - (fist + rng.uniform(0.3, 0.9) * arm_length) * z
        else:
            z = n + rng.uniform(0.0, 0.7) * _unit(np.cross(n, rng.normal(size=3)))
            z /= np.linalg.norm(z)
            origin = p + (finger if kind == "finger" else fist) * (n - z)
        x = _unit(np.cross(rng.normal(size=3), z))
        return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), origin)


def _unit(a: Array) -> Array:
    return a / np.linalg.norm(a)
