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


class SystemStatus(IntEnum):
    """Whether a system can work with its inputs, also published as a number.

    Every system has one rule: an input that is not finite or has a wrong size raises nothing. The system says so here,
    puts out NaN (not known) or the safe value that its ports name, and works again as soon as its inputs do.
    """

    OK = 0
    BAD_INPUT = 1  # an input is not finite, or has a wrong size
    HOLDING = 2  # the command cannot be used, or could not a moment ago: keep the posture
    BRAKES_ON = 3  # the state of the robot is not known: apply the brakes, torque carries the weight


def status_of(*values: NDArray[np.float64]) -> SystemStatus:
    """Return OK if all values are finite, else BAD_INPUT."""
    return SystemStatus.OK if all(np.isfinite(value).all() for value in values) else SystemStatus.BAD_INPUT


def _finite(value: NDArray[np.float64], shape: tuple[int, ...]) -> bool:
    return np.shape(value) == shape and bool(np.isfinite(value).all())


def _on(link: int, links: int, p: NDArray[np.float64]) -> bool:
    return isinstance(link, int | np.integer) and bool(0 <= link < links) and _finite(p, (3,))


class CommandMode(IntEnum):
    """What becomes of the command of a controller, also published as a number."""

    HOLD = 0  # keep the posture instead
    PASS = 1  # pass it on
    BRAKE = 2  # come to rest instead, quickly, and stay there
    YIELD = 3  # give way instead, about the latched posture and not far


@dataclass(frozen=True)
class Selection(Immutable):
    """What `CommandSwitch` shall do with a command.

    Attributes
    ----------
    mode : CommandMode
    q_latched : (n,) array
        Joint positions to hold, or to give way about (rad or m), in HOLD and YIELD.
    key : tuple of int
        Whatever tells one law from the next; a change hands over as a change of mode does.
    """

    mode: CommandMode = CommandMode.PASS
    q_latched: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    key: tuple[int, ...] = ()


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
    YIELD = 3  # touched, but not seen where: give way about the posture where it was felt, and return to it
    STOP = 4  # the camera is lost: come to rest and stay there


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

    def usable(self, links: int) -> bool:
        """Whether it is a point, of three finite numbers, on one of so many links."""
        return _on(self.link, links, self.p_LC)


class ObstacleStatus(IntEnum):
    """State of a source of obstacle points, also published as a number."""

    OK = 0  # all points seen now
    HELD = 1  # some point is lost or repaired and held where it was last seen
    LOST = 2  # the source is older than allowed, or sees nothing that can be used: whoever needs it must stop


@dataclass(frozen=True)
class ObstaclePoints(Immutable):
    """Points of people and things to keep a distance from, with their velocities.

    Attributes
    ----------
    p_WO : (m, 3) array
        Positions in the world (m).
    v_WO : (m, 3) array
        Velocities in the world (m/s), zero where they are not known.
    radius : (m,) array
        How far the obstacle reaches around each point (m).
    stamp : float
        Time at which the points were seen (s); −∞: they hold at all times, as things that stand still.
    status : ObstacleStatus
    """

    p_WO: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    v_WO: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    radius: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    stamp: float = -np.inf
    status: ObstacleStatus = ObstacleStatus.OK

    @property
    def usable(self) -> bool:
        """Whether all sizes fit, all numbers are finite, and no radius is negative."""
        m = len(self.p_WO)
        fits = _finite(self.p_WO, (m, 3)) and _finite(self.v_WO, (m, 3)) and _finite(self.radius, (m,))
        return fits and bool(np.min(self.radius, initial=0.0) >= 0.0)

    def age(self, time: float) -> float:
        """Return how long ago they were seen (s): 0 where they hold at all times, ∞ for a stamp that is no number."""
        if self.stamp == -np.inf:
            return 0.0
        return max(time - self.stamp, 0.0) if np.isfinite(self.stamp) else np.inf


class SkinStatus(IntEnum):
    """State of a skin patch, also published as a number."""

    OK = 0
    DEGRADED = 1  # some modules are dead: they are left out, and named
    SATURATED = 2  # a module is at the end of its range: the force is a lower bound
    LOST = 3  # too few modules can be used, or samples are too old: whoever needs the skin must stop


@dataclass(frozen=True)
class SkinContact(Immutable):
    """One patch of pressure on a skin.

    Attributes
    ----------
    link : int
        Index of the link that carries the skin.
    p_LC : (3,) array
        Contact point on the skin's surface, in the link frame (m).
    n_L : (3,) array
        Outward surface normal there, in the link frame.
    f_L : (3,) array
        Force of the person on the robot, in the link frame (N).
    """

    link: int
    p_LC: NDArray[np.float64]
    n_L: NDArray[np.float64]
    f_L: NDArray[np.float64]

    def usable(self, links: int) -> bool:
        """Whether it is a point and a force, of three finite numbers each, on one of so many links."""
        return _on(self.link, links, self.p_LC) and _finite(self.f_L, (3,))

    @property
    def normal_force(self) -> float:
        """Force into the surface (N, positive when pressed)."""
        return -float(self.n_L @ self.f_L)


@dataclass(frozen=True)
class SkinReading(Immutable):
    """What a skin feels.

    Attributes
    ----------
    contacts : tuple of SkinContact
        The strongest first; empty if nobody touches.
    status : SkinStatus
    dead : tuple of int
        Modules that are left out.
    stamp : float
        Time of the measurement (s).
    """

    contacts: tuple[SkinContact, ...] = ()
    status: SkinStatus = SkinStatus.OK
    dead: tuple[int, ...] = ()
    stamp: float = -np.inf
