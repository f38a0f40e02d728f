"""The hands that touch the robot in random scenes: their sizes, their shapes, and how they lie at a contact."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Capsule, Shape, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from experiments.localization.parameters import SceneParameters

Array = NDArray[np.float64]
Part = tuple[Shape, RigidTransform, str]  # a shape, its pose in the frame of its body, and its name


class Hands:
    """Plain hands of several sizes; z of a hand points away from the contact, its origin is the tip of what touches.

    Parameters
    ----------
    params : SceneParameters
    rng : Generator
        Draws the sizes.
    """

    kinds: ClassVar[tuple[str, ...]] = ("finger", "fist", "forearm")  # of what touches
    bodies: ClassVar[tuple[str, ...]] = ("finger", "fist")

    def __init__(self, params: SceneParameters, rng: np.random.Generator) -> None:
        self._params, self.count = params, params.hands
        self.people = self._drawn(rng)

    def _drawn(self, rng: np.random.Generator) -> list[dict[str, float]]:
        """Return the lengths (m) of each hand."""
        names = ("finger_radius", "finger_length", "fist_radius", "forearm_radius", "forearm_length")
        return [{name: rng.uniform(*getattr(self._params, name)) for name in names} for _ in range(self.count)]

    def body(self, kind: str) -> str:
        """Return which body touches."""
        return "fist" if kind == "forearm" else kind

    def size(self, kind: str, hand: int) -> float:
        """Return the radius of what touches (m)."""
        return float(self.people[hand][f"{kind}_radius"])

    def parts(self, body: str, hand: int) -> list[Part]:
        """Return the shapes of a body, each with its pose in the body's frame and its name."""
        finger, length, fist, arm, arm_length = self.people[hand].values()
        start = length if body == "finger" else 0.0
        parts: list[tuple[Shape, float, str]] = [
            (Sphere(fist), start + fist, "fist"),
            (Capsule(arm, arm_length), start + fist + arm_length / 2, "arm"),
        ]
        if body == "finger":
            straight = length + fist - finger
            parts.append((Capsule(finger, straight), finger + straight / 2, "finger"))
        return [(shape, RigidTransform([0.0, 0.0, z]), name) for shape, z, name in parts]

    def pose(self, rng: np.random.Generator, kind: str, hand: int, p: Array, n: Array) -> RigidTransform:
        """Return a random pose of a hand that touches a surface at p with outward normal n (3,), in the world."""
        finger, _, fist, arm, arm_length = self.people[hand].values()
        if kind == "forearm":  # its side touches somewhere along its length
            z = np.cross(n, rng.normal(size=3))
            z /= np.linalg.norm(z)
            origin = p + arm * n - (fist + rng.uniform(0.3, 0.9) * arm_length) * z
        else:
            z = n + rng.uniform(0.0, 0.7) * unit(np.cross(n, rng.normal(size=3)))
            z /= np.linalg.norm(z)
            origin = p + (finger if kind == "finger" else fist) * (n - z)
        x = unit(np.cross(rng.normal(size=3), z))
        return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), origin)

    def trunk(self, kind: str, hand: int, X_WH: RigidTransform, p: Array) -> RigidTransform | None:
        """Return the pose of the trunk that the hand at a contact p (3,) belongs to, if it is shown."""
        return None

    def sleeves(self, kind: str, hand: int) -> list[Part]:
        """Return the parts of a hand that a sleeve covers."""
        return []


def unit(a: Array) -> Array:
    """Return a vector of length 1."""
    return a / np.linalg.norm(a)
