"""A person as capsules on a skeleton: which there are, how large, and what region of the body each is."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.parameters import require_positive
from saphari_drake.simulation.people.bvh import BodyRecording

Array = NDArray[np.float64]

# The joints that all of this needs, by the names of the recordings.
JOINTS = (
    "hip", "neck", "head", "left_upper_arm", "left_forearm", "left_hand", "right_upper_arm", "right_forearm",
    "right_hand",
)  # fmt: skip
HIP, NECK, HEAD, L_SHOULDER, L_ELBOW, L_WRIST, R_SHOULDER, R_ELBOW, R_WRIST = range(len(JOINTS))


class Segment(NamedTuple):
    """A capsule between two points of the skeleton."""

    name: str
    region: str  # of `body_regions.yaml`
    radius: str  # field of `PersonSizes`


SEGMENTS = (
    Segment("head", "skull", "head"),
    Segment("neck", "neck", "neck"),
    Segment("trunk", "abdomen", "trunk"),
    Segment("shoulders", "chest", "shoulder"),
    Segment("left upper arm", "upper_arm", "upper_arm"),
    Segment("left forearm", "forearm", "forearm"),
    Segment("left hand", "hand", "hand"),
    Segment("right upper arm", "upper_arm", "upper_arm"),
    Segment("right forearm", "forearm", "forearm"),
    Segment("right hand", "hand", "hand"),
    Segment("left leg", "thigh", "leg"),
    Segment("right leg", "thigh", "leg"),
)
HANDS = tuple(i for i, segment in enumerate(SEGMENTS) if segment.region == "hand")


@dataclass
class PersonSizes:
    """Radii of a person's segments, and what the recordings lack. All assumed (m)."""

    head: float = 0.10
    neck: float = 0.055
    trunk: float = 0.14
    shoulder: float = 0.07
    upper_arm: float = 0.05
    forearm: float = 0.04
    hand: float = 0.04
    leg: float = 0.08
    # From the wrist to the finger tips' middle, along the forearm, and half the distance between the legs.
    hand_length: float = 0.10
    half_hip: float = 0.10
    # Of the middle of the hips above the floor.
    hip_height: float = 0.95

    def __post_init__(self) -> None:
        require_positive(self, *vars(self))

    def radii(self) -> Array:
        """Return the radii of `SEGMENTS` (k,)."""
        return np.array([getattr(self, segment.radius) for segment in SEGMENTS])


def segment_ends(joints: Array, sizes: PersonSizes) -> Array:
    """Return both ends of each of `SEGMENTS` (…, k, 2, 3) for joints (…, J, 3), world; legs go to the floor."""
    joint = [joints[..., j, :] for j in range(len(JOINTS))]
    hip, neck, head = joint[HIP], joint[NECK], joint[HEAD]
    skull = neck + 0.75 * (head - neck)
    across = joint[L_SHOULDER] - joint[R_SHOULDER]
    across = across * np.array([1.0, 1.0, 0.0])
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    rows = [(skull, skull), (neck, skull), (hip, neck + 0.2 * (hip - neck)), (joint[L_SHOULDER], joint[R_SHOULDER])]
    for shoulder, elbow, wrist in ((L_SHOULDER, L_ELBOW, L_WRIST), (R_SHOULDER, R_ELBOW, R_WRIST)):
        along = joint[wrist] - joint[elbow]
        along = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
        tip = joint[wrist] + sizes.hand_length * along
        rows += [(joint[shoulder], joint[elbow]), (joint[elbow], joint[wrist]), (joint[wrist], tip)]
    for side in (1.0, -1.0):
        top = hip + side * sizes.half_hip * across
        rows.append((top, top * np.array([1.0, 1.0, 0.0]) + np.array([0.0, 0.0, sizes.leg])))
    return np.stack([np.stack(row, axis=-2) for row in rows], axis=-3)


def upright(recording: BodyRecording, sizes: PersonSizes, unit: float = 1e-3) -> Array:
    """Return the joints (T, J, 3) of a recording in m: x ahead, y to the left, z up, the floor at z = 0.

    The files of `human-robot-animations` have y up, z ahead and x to the right, in mm: a left-handed frame. Their
    origin is at no known height: the hips are put at `sizes.hip_height`, in the median, above the origin.
    """
    index = [recording.index(name) for name in JOINTS]
    given = unit * recording.points[:, index]
    p = np.stack([given[..., 2], -given[..., 0], given[..., 1]], axis=-1)
    return p - np.median(p[:, HIP], axis=0) + np.array([0.0, 0.0, sizes.hip_height])


def standing(sizes: PersonSizes) -> Array:
    """Return the joints (J, 3) of a person who stands at the origin and looks along x, with hanging arms."""
    h, side = sizes.hip_height, np.array([1.0, -1.0])
    arms = [[(0.0, 0.18 * s, h + 0.42), (0.03, 0.22 * s, h + 0.15), (0.12, 0.22 * s, h - 0.08)] for s in side]
    return np.array([(0.0, 0.0, h), (0.0, 0.0, h + 0.45), (0.03, 0.0, h + 0.75), *arms[0], *arms[1]])
