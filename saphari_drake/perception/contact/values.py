"""Parameters, evidence, memory and result of the contact fusion."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.messages import Immutable
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.contact.vision import Array, Localization


@dataclass
class FusionParameters:
    """Numbers of the fusion."""

    # Points of the surface that are weighed (≥ 10).
    candidates: int = 1700
    # Standard deviation of the residual of each joint (Nm, > 0), and size of a usual force (N, > 0).
    torque_sigma: float = 0.2
    force_scale: float = 30.0
    # Friction of skin on the cover, and the share of the largest singular value below which a direction is left out.
    friction: float = 0.5
    rcond: float = 0.02
    # Norm of the residual above which a contact is felt (deviations of one joint, > 0).
    felt: float = 5.0
    # Deviation of a point that the cameras see (m, > 0): of a fine one, its growth with the width of what touches, and
    # that of a fitted limb (m, > 0).
    vision_sigma: float = 0.003
    width_share: float = 0.4
    limb_sigma: float = 0.006
    # Distance of the person up to which a point is taken as it is, and by which more costs 1 (m, > 0).
    near: float = 0.015
    far: float = 0.010
    # Cost of a contact where nobody is seen on the surface although somebody is seen touching it (≥ 0).
    unseen_cost: float = 12.0
    # Cost of a contact in space that is seen to be free (≥ 0), within these distances of the person none to full (m).
    free_cost: float = 16.0
    free_from: float = 0.03
    free_to: float = 0.07
    # Distance from the person's visible parts that costs 1 (m, > 0), and the most that distance costs (≥ 0).
    person_scale: float = 0.06
    person_cost: float = 12.0
    # Distance between two modes (m, > 0), and number of grid modes that are refined (≥ 2).
    mode_distance: float = 0.05
    modes: int = 3
    # Weight of a frame's residual when the next one arrives (0–1), and frames that are kept (≥ 1).
    memory: float = 0.9
    # Share of a force that is new with each frame (0–1).
    again: float = 0.2
    frames: int = 8
    # Forces of two contacts: a usual one along the normal (N, ≥ 0), its deviations along and across it (N, > 0),
    # and those of a frame's force from the mean of the last frames (N, > 0).
    usual_force: float = 20.0
    usual_along: float = 15.0
    usual_across: float = 6.0
    force_along: float = 4.0
    force_across: float = 3.0
    # Two contacts are two places where the person is seen, so far apart (m, > 0), at both of which a force of this size
    # (N, ≥ 0) comes out, and which explain the mean residual better than any one does by at least this cost (≥ 0).
    second_distance: float = 0.10
    second_force: float = 3.0
    second_cost: float = 0.0

    def __post_init__(self) -> None:
        require_positive(
            self, "candidates", "torque_sigma", "force_scale", "friction", "felt", "vision_sigma", "limb_sigma", "near",
            "far",
            "free_from", "free_to", "person_scale", "mode_distance", "modes", "frames",
            "second_distance", "usual_along", "usual_across", "force_along", "force_across",
        )  # fmt: skip
        require_non_negative(
            self, "width_share", "unseen_cost", "free_cost", "person_cost", "usual_force", "second_force", "second_cost"
        )
        if not 0.0 <= self.memory <= 1.0:
            raise ParameterError("memory", f"must lie in 0–1, got {self.memory}")
        if not 0.0 <= self.again <= 1.0:
            raise ParameterError("again", f"must lie in 0–1, got {self.again}")
        if not 0.0 < self.rcond < 1.0:
            raise ParameterError("rcond", f"must lie between 0 and 1, got {self.rcond}")
        if self.free_to <= self.free_from:
            raise ParameterError("free_to", f"must be above free_from ({self.free_from} m), got {self.free_to}")


class Evidence(NamedTuple):
    """What one instant shows. Costs are those of the candidates."""

    S: Array  # (n, 6) joint axes
    R_WL: Array  # (n, 3, 3)
    p_WL: Array  # (n, 3)
    r: Array  # (n,) residual, Nm
    misfit: Array  # (m,) of the residual
    spread: Array  # (m,) of the forces that would explain it
    vision_cost: Array  # (m,)
    seen: tuple[Localization, ...]  # places where a camera sees the person within its gate
    human_points: Array  # (k, 3) m, world
    shares: dict[int, float]  # camera: share of the robot that it sees, for those with a frame


@dataclass(frozen=True)
class FusionMemory(Immutable):
    """Evidence of the frames of the present contact, newest last; empty without contact."""

    S: Array
    R_WL: Array
    p_WL: Array
    r: Array
    misfit: Array  # (m,) summed with forgetting
    spread: Array  # (m,) mean with forgetting
    vision_cost: Array  # (m,) mean with forgetting
    weight: float = 0.0  # sum of the weights of all frames
    seen: tuple[tuple[Localization, ...], ...] = ()

    @property
    def count(self) -> int:
        """Number of frames kept."""
        return len(self.r)

    def groups(self, size: int, memory: float) -> tuple[NDArray[np.int64], Array, Array]:
        """Return the last frame (k,) of each group of `size` frames, the groups' weights (k,), mean residuals (k, n).

        The newest frames are grouped first; a frame weighs `memory` times the one after it.
        """
        count = self.count
        weight = memory ** np.arange(count - 1, -1, -1)
        last = np.arange((count - 1) % size, count, size)
        first = np.concatenate([[0], last[:-1] + 1])
        weights = np.add.reduceat(weight, first)
        return last, weights, np.add.reduceat(weight[:, None] * self.r, first) / weights[:, None]


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
    """

    modes: list[Mode]
    second: Mode | None
    second_weight: float
    forces: Array
