"""People as they are measured: hands that pinch and press, tapered arms with elbows, trunk and head, thin to broad.

Lengths of the 5th percentile of women and the 95th of men, rounded: DIN 33402-2 (2020) and A. Tilley, H. Dreyfuss, "The
measure of man and woman", 2002; from memory, circumferences as radii. Each person has one percentile, from which each
length differs a little.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Capsule, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from experiments.localization.hands import Hands, Part, unit

Array = NDArray[np.float64]

# m; 5th and 95th percentile.
_LENGTHS = {
    "finger": (0.0065, 0.0105),  # radius of its tip
    "finger_length": (0.060, 0.082),
    "fist": (0.036, 0.050),  # radius
    "wrist": (0.023, 0.030),  # radii, of the forearm at both ends
    "forearm": (0.034, 0.049),
    "forearm_length": (0.21, 0.28),
    "elbow": (0.033, 0.044),  # radius
    "upper_arm": (0.037, 0.058),  # radius
    "upper_arm_length": (0.28, 0.37),
    "palm": (0.011, 0.015),  # half its thickness
    "palm_breadth": (0.071, 0.093),
    "palm_length": (0.159, 0.207),
    "head": (0.075, 0.095),  # radius
    "trunk": (0.12, 0.17),  # radius
}
_VARIED = 0.1  # share of the range by which a person's lengths differ from its percentile
_TAPER = 4  # pieces of a forearm
_SHARP = 1.2  # rad; an elbow that touches is bent at least so much
_SPREAD = 0.35  # rad, between each finger that pinches and the hand
_WRIST = (0.4, 0.9)  # rad, by which the arm rises from a flat hand


class People(Hands):
    """Hands with arms, and the trunks and heads that they belong to."""

    kinds = ("finger", "fist", "forearm", "pinch", "palm", "elbow")
    bodies = ("finger", "fist", "pinch", "palm", "elbow", "trunk")

    def _drawn(self, rng: np.random.Generator) -> list[dict[str, float]]:
        """Return the lengths (m) and angles (rad) of each person."""
        people = []
        for percentile in rng.uniform(0.0, 1.0, self.count):
            own = np.clip(percentile + _VARIED * rng.normal(size=len(_LENGTHS)), 0.0, 1.0)
            person = {name: low + share * (high - low) for (name, (low, high)), share in zip(_LENGTHS.items(), own)}
            people.append({**person, "bend": rng.uniform(0.4, 1.9), "wrist_bend": rng.uniform(*_WRIST)})
        return people

    def size(self, kind: str, hand: int) -> float:
        """Return the radius of what touches, or half its thickness (m)."""
        return float(self.people[hand]["finger" if kind == "pinch" else kind])

    def parts(self, body: str, hand: int) -> list[Part]:
        """Return the shapes of a body, each with its pose in the body's frame and its name."""
        s = self.people[hand]
        tip, length = s["finger"], s["finger_length"]
        finger = Capsule(tip, length + s["fist"] - tip)
        middle = tip + finger.length() / 2
        if body == "trunk":
            neck = 0.30 + s["head"]
            return [
                (Capsule(s["trunk"], 0.45), RigidTransform(), "chest"),
                (Sphere(s["head"]), RigidTransform([0.0, 0.0, neck]), "head"),
            ]
        if body == "elbow":  # whose arms begin where they do not stand out before it
            half = 0.5 * (np.pi - max(s["bend"], _SHARP))
            ahead = [max(s[arm] - s["elbow"], 0.0) / np.cos(half) for arm in ("forearm", "upper_arm")]
            turns = [RigidTransform(RollPitchYaw(0.0, turn, 0.0), np.zeros(3)) for turn in (half, -half)]
            frames = [X @ RigidTransform([0.0, 0.0, way]) for X, way in zip(turns, ahead)]
            forearm = self._forearm(hand, frames[0], outward=False)
            return [(Sphere(s["elbow"]), RigidTransform(), "elbow"), *forearm, self._upper_arm(hand, 0.0, frames[1])]
        if body == "palm":
            step, thick = s["palm_breadth"] / 5.0, s["palm"]
            flat = Capsule(thick, s["palm_length"] - 2.0 * thick)
            pieces = [(flat, RigidTransform([k * step, 0.0, 0.0]), f"palm_{k + 2}") for k in range(-2, 3)]
            wrist = RigidTransform(RollPitchYaw(-s["wrist_bend"], 0.0, 0.0), [0.0, 0.5 * s["wrist"], flat.length() / 2])
            return [*pieces, *self._arm(hand, wrist)]
        start = length if body in ("finger", "pinch") else 0.0
        parts: list[Part] = [(Sphere(s["fist"]), RigidTransform([0.0, 0.0, start + s["fist"]]), "hand")]
        if body == "finger":
            parts.append((finger, RigidTransform([0.0, 0.0, middle]), "finger"))
        for side in (-1.0, 1.0) if body == "pinch" else ():
            lean = RotationMatrix(RollPitchYaw(0.0, side * _SPREAD, 0.0))
            along = lean @ [0.0, 0.0, finger.length() / 2]
            X = RigidTransform(lean, np.array([side * tip, 0.0, tip]) + along)
            parts.append((finger, X, f"finger_{side:.0f}".replace("-", "other_")))
        return [*parts, *self._arm(hand, RigidTransform([0.0, 0.0, start + s["fist"]]))]

    def _forearm(self, hand: int, X: RigidTransform, outward: bool = True) -> list[Part]:
        """Return the pieces of a forearm along z of a frame, from its wrist (`outward`) or its elbow."""
        s, pieces = self.people[hand], []
        length = s["forearm_length"] / _TAPER
        for k in range(_TAPER):
            share = (k + 0.5) / _TAPER if outward else 1.0 - (k + 0.5) / _TAPER
            radius = s["wrist"] + share * (s["forearm"] - s["wrist"])
            pieces.append((Capsule(radius, length), X @ RigidTransform([0.0, 0.0, (k + 0.5) * length]), f"arm_{k}"))
        return pieces

    def _upper_arm(self, hand: int, turn: float, X: RigidTransform) -> Part:
        """Return the upper arm from an elbow at X, turned about y (rad)."""
        s = self.people[hand]
        lean = X @ RigidTransform(RollPitchYaw(0.0, turn, 0.0), np.zeros(3))
        half = s["upper_arm_length"] / 2
        return Capsule(s["upper_arm"], 2.0 * half), lean @ RigidTransform([0.0, 0.0, half]), "upper_arm"

    def _arm(self, hand: int, X: RigidTransform) -> list[Part]:
        """Return forearm, elbow and upper arm from a wrist at X on."""
        s = self.people[hand]
        elbow = X @ RigidTransform([0.0, 0.0, s["forearm_length"]])
        joint = (Sphere(s["elbow"]), elbow, "elbow")
        return [*self._forearm(hand, X), joint, self._upper_arm(hand, s["bend"], elbow)]

    def pose(self, rng: np.random.Generator, kind: str, hand: int, p: Array, n: Array) -> RigidTransform:
        """Return a random pose of a hand that touches a surface at p with outward normal n (3,), in the world."""
        s, side = self.people[hand], unit(np.cross(n, rng.normal(size=3)))
        if kind == "palm":  # its flat side lies on the surface
            origin, z, x = p + s["palm"] * n, side, np.cross(n, side)
        elif kind == "forearm":
            piece = int(rng.integers(1, _TAPER))
            shape, X, _ = self._forearm(hand, RigidTransform([0.0, 0.0, s["fist"]]))[piece]
            z, x = side, unit(np.cross(rng.normal(size=3), side))
            origin = p + shape.radius() * n - X.translation()[2] * z
        else:
            x, radius = side, self.size(kind, hand)
            z = unit(n + rng.uniform(0.0, 0.7) * np.cross(n, x))
            origin = p + radius * n if kind == "elbow" else p + radius * (n - z)
        return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), origin)

    def trunk(self, kind: str, hand: int, X_WH: RigidTransform, p: Array) -> RigidTransform | None:
        """Return the pose of the trunk, upright beside the shoulder and away from the contact p (3,)."""
        s = self.people[hand]
        shape, X, _ = self.parts(self.body(kind), hand)[-1]
        shoulder = X_WH @ X @ np.array([0.0, 0.0, shape.length() / 2])
        away = unit((shoulder - p) * [1.0, 1.0, 0.0] + [1e-9, 0.0, 0.0])
        return RigidTransform(shoulder + (s["trunk"] + 0.5 * s["upper_arm"]) * away - [0.0, 0.0, 0.18])

    def sleeves(self, kind: str, hand: int) -> list[Part]:
        """Return the parts of a hand that a sleeve covers."""
        return [part for part in self.parts(self.body(kind), hand) if "arm" in part[2] or part[2] == "elbow"]
