"""Evidence, memory and result of the contact fusion."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.messages import ContactPoint, Immutable
from saphari_drake.perception.camera.frames import Instant
from saphari_drake.perception.contact.places import Place
from saphari_drake.perception.contact.pointing import Ray
from saphari_drake.perception.contact.refinement import Window

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactModes(Immutable):
    """All places where a contact may be.

    Attributes
    ----------
    contacts : tuple of ContactPoint
        Likeliest first.
    weights : (k,) array
        Their probabilities, ≤ 1 together.
    stamp : float
        Time at which the image was taken (s).
    """

    contacts: tuple[ContactPoint, ...] = ()
    weights: Array = field(default_factory=lambda: np.zeros(0))
    stamp: float = -np.inf


class Evidence(NamedTuple):
    """What one instant shows. Costs are those of the candidates."""

    at: Instant  # with its residual
    misfit: Array  # (m,) of the residual
    spread: Array  # (m,) of the forces that would explain it
    vision_cost: Array  # (m,)
    seen: tuple[Place, ...]  # where a camera sees the person within its gate
    rays: tuple[Ray, ...]  # where limbs point


@dataclass(frozen=True)
class FusionMemory(Immutable):
    """Evidence of the frames of the present contact, newest last; no frame without contact."""

    misfit: Array  # (m,) summed with forgetting
    spread: Array  # (m,) mean with forgetting
    vision_cost: Array  # (m,) mean with forgetting
    frames: tuple[Instant, ...] = ()
    seen: tuple[tuple[Place, ...], ...] = ()
    rays: tuple[Ray, ...] = ()  # of the newest frame
    weight: float = 0.0  # sum of the weights of all frames

    def weights(self, memory: float) -> Array:
        """Return the weights (k,) of the frames: each `memory` times that of the one after it, the newest 1."""
        return np.power(memory, np.arange(len(self.frames) - 1, -1, -1, dtype=float))

    def window(self, size: int, memory: float) -> Window:
        """Return the frames in groups of `size`, the newest first: the last of each, weights and mean residuals."""
        weight = self.weights(memory)
        last = np.arange((len(weight) - 1) % size, len(weight), size)
        first = np.concatenate([[0], last[:-1] + 1])
        total = np.add.reduceat(weight, first)
        r = np.array([at.r for at in self.frames])
        mean = np.add.reduceat(weight[:, None] * r, first) / total[:, None]
        kept = [self.frames[k] for k in last]
        S, R_WL, p_WL = (np.array([getattr(at.motion, name) for at in kept]) for name in ("S", "R_WL", "p_WL"))
        return Window(S, R_WL, p_WL, mean, total)


class Mode(NamedTuple):
    """One explanation of what is felt."""

    link: int
    p_L: Array  # (3,) m
    n_L: Array  # (3,)
    cost: float
    seen: bool  # whether a camera sees the person there
    distance: float  # m, of the person there (∞: unseen)
    sigma: float = np.inf  # m, deviation of the point that a camera sees
    prior: float = 0.0  # part of the cost that the cameras alone decide
    anchor: Array | None = None  # (3,) m, the point that the cameras see, in the link's frame
    limb: bool = False  # whether what a camera sees there is explained as a limb
    ray: Array = np.zeros(3)  # (3,) unit in the link's frame; only deviations across it count. Zero: all
    shared: int = -1  # link beyond this one that is touched too at its border and takes a part of the force; −1: none

    @property
    def moved(self) -> float:
        """−2 log of how likely the cameras make the point, given the one that they see."""
        if self.anchor is None:
            return 0.0
        away = self.p_L - self.anchor
        return float((away @ away - (away @ self.ray) ** 2) / self.sigma**2)


class Fusion(NamedTuple):
    """Result of the fusion.

    Attributes
    ----------
    modes : list of Mode
        The contact; both, if two are felt.
    second : Mode, optional
        Best explanation elsewhere.
    second_weight : float
        Its probability against that of the contact (0–0.5).
    forces : (k, 3) array
        Force of the person on the robot at each contact (N, world).
    places : sequence of Mode
        All places whose probability is worth a word, likeliest first.
    weights : (m,) array
        Their probabilities, ≤ 1 together.
    seen : sequence of Mode
        Explanations where a camera sees the person, likeliest first.
    """

    modes: list[Mode]
    second: Mode | None
    second_weight: float
    forces: Array
    places: Sequence[Mode] = ()
    weights: Array = np.zeros(0)
    seen: Sequence[Mode] = ()

    def all_modes(self, stamp: float) -> ContactModes:
        """Return all places and their weights at a time (s) as a message."""
        return ContactModes(tuple(contact_point(mode, stamp) for mode in self.places), self.weights, stamp)

    def contact(self, k: int, stamp: float) -> ContactPoint:
        """Return contact `k` at a time (s), not found if there is none."""
        return contact_point(self.modes[k] if k < len(self.modes) else None, stamp)

    def force(self, k: int) -> Array:
        """Return the force (3,) at contact `k`, zero without one (N)."""
        return self.forces[k] if k < len(self.forces) else np.zeros(3)


NOTHING = Fusion([], None, 0.0, np.zeros((0, 3)))


def contact_point(mode: Mode | None, stamp: float) -> ContactPoint:
    """Return a mode at a time (s) as a message."""
    if mode is None:
        return ContactPoint(stamp=stamp)
    return ContactPoint(True, mode.link, mode.p_L, mode.n_L, mode.distance, stamp)


def weighed(modes: Sequence[Mode], p: Array, apart: float, least: float) -> tuple[list[Mode], Array]:
    """Return the places of modes at points p (m, 3) whose probability is at least `least` (0–1), and these (k,).

    A mode that lies within `apart` (m) of a likelier one is the same place and adds its probability to it.
    """
    cost = np.array([mode.cost for mode in modes])
    share = np.exp(-0.5 * (cost - cost.min()))
    share /= share.sum()
    found, total = _gathered(np.argsort(cost, kind="stable"), p, share, apart)
    leaders = sorted((i for i in found.tolist() if total[i] >= least), key=lambda i: -total[i])
    return [modes[i] for i in leaders], total[leaders]


@njit(cache=True)
def _gathered(order, p, share, apart):
    """Return the places among points p (m, 3), likeliest first by `order`, and the sums (m,) of the shares there."""
    leaders, count, total = np.empty_like(order), 0, np.zeros(len(order))
    for i in order:
        near = i
        for j in leaders[:count]:
            if (p[i, 0] - p[j, 0]) ** 2 + (p[i, 1] - p[j, 1]) ** 2 + (p[i, 2] - p[j, 2]) ** 2 < apart * apart:
                near = j
                break
        total[near] += share[i]
        if near == i:
            leaders[count] = i
            count += 1
    return leaders[:count], total
