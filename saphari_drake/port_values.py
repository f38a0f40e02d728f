"""Values that travel on abstract ports, so that the parts which exchange them need not import one another."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray


class Immutable:
    """Base of values that are replaced, never changed in place: clones of a Context share them instead of copying."""

    def __deepcopy__(self, memo: dict) -> Self:
        return self


class CameraStatus(IntEnum):
    """State of a camera as the localizer sees it, also published as a number."""

    WAITING = 0  # no frame yet, and the first one is not overdue
    OK = 1
    STALE = 2  # the last frame is older than allowed
    INVALID = 3  # frames arrive but hold almost no reading


class InteractionMode(IntEnum):
    """What the robot does about a person, also published as a number."""

    HOLD = 0  # nobody touches: keep the posture
    CONTACT = 1  # touched at a known point
    RETURN = 2  # released: the contact point goes back to where it was touched
    YIELD = 3  # touched, but not seen where: only damping and gravity compensation
    STOP = 4  # the camera is lost: compliant stop


class ForceStatus(IntEnum):
    """What the force control does, and why it does not control a force, also published as a number."""

    HOLD = 0  # nobody touches: keep the posture
    CONTROLLED = 1  # the force is controlled in all directions
    PARTIAL = 2  # controlled, except along directions in which joint torques do not show it
    WEAK = 3  # touched with a force below the gate: brake
    RELEASED = 4  # braking to rest after the release
    SPEED_STOP = 5  # the contact would have become too fast, as when nobody resists the desired force: brake
    UNSEEN = 6  # touched, but not seen where: yield
    NO_CAMERA = 7  # the camera is lost: compliant stop


@dataclass(frozen=True)
class Interaction(Immutable):
    """Decision of the contact monitor, for the estimator and the controllers.

    Attributes
    ----------
    mode : InteractionMode
    contact : ContactPoint
        The contact that is controlled (in CONTACT and RETURN).
    q_latched : (n,) array
        Joint positions at the onset of the contact, or those to hold.
    onset : int
        Counts contacts and postures latched; a change means that `q_latched` is new.
    """

    mode: InteractionMode
    contact: ContactPoint
    q_latched: NDArray[np.float64]
    onset: int


@dataclass(frozen=True)
class ContactPoint(Immutable):
    """Where a person touches, or nearly touches, the robot.

    Attributes
    ----------
    found : bool
        Whether a person was seen close enough to be in contact; nothing else is meaningful if not.
    link : int
        Index of the link in the robot model (−1: none).
    p_LC : (3,) array
        Contact point on the link's surface, in the link frame (m).
    n_L : (3,) array
        Outward surface normal there, in the link frame.
    distance : float
        Distance of the nearest seen point of the person to the robot's surface (m).
    stamp : float
        Time at which the image was taken (s).
    """

    found: bool = False
    link: int = -1
    p_LC: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    n_L: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    distance: float = np.inf
    stamp: float = -np.inf
