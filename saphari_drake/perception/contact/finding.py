"""The contact from frame to frame: where the person is seen, and of a touch that is felt, what explains it best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import ClassVar, NamedTuple

import numpy as np

from saphari_drake.messages import ContactPoint
from saphari_drake.perception.camera.frames import Instant
from saphari_drake.perception.contact.law import ContactFusionLaw
from saphari_drake.perception.contact.parameters import FusionParameters, LocalizerParameters
from saphari_drake.perception.contact.places import Place, View
from saphari_drake.perception.contact.track import ContactTrack, ContactTracker
from saphari_drake.perception.contact.values import NOTHING, Fusion, FusionMemory, contact_point
from saphari_drake.robots.model import RobotModel

# Share of each frame in the mean square of what is left unexplained, and the most by which that raises a deviation.
_NEW, _WORST = 0.1, 10.0
Outputs = MappingProxyType[str, Callable[["Found", float], object]]


class Found(NamedTuple):
    """What is remembered of the frames, and what they show."""

    seen: ContactTrack = ContactTrack()  # what the cameras see
    touch: ContactTrack = ContactTrack()  # where the touch is that is felt
    evidence: FusionMemory | None = None
    fusion: Fusion = NOTHING
    felt: bool = False  # whether a touch is felt
    # Whether what is seen lies so near that it touches, whatever explains the residual better; or did in this touch.
    near: bool = False
    # Mean square of what touches leave unexplained of the residual, over that while nobody touches: model and friction
    # are wrong where forces act and joints move.
    wrong: float = 1.0

    @property
    def raised(self) -> float:
        """By how much the deviation of a residual is larger than while nobody touches.

        What is wrong is so in all frames that are remembered: together they tell no more than one of them.
        """
        weight = 1.0 if self.evidence is None else max(self.evidence.weight, 1.0)
        return float(np.sqrt(1.0 + weight * (self.wrong - 1.0)))

    @property
    def contact(self) -> ContactPoint:
        """The contact: where the touch is that is felt, else where the person is seen."""
        return self.touch.contact if self.felt else self.seen.contact


def still_near(known: Found, seen: ContactPoint, felt: bool, near: float) -> bool:
    """Return whether what is seen touches: it is as near as `near` (m), or has been so in the touch that is felt."""
    return seen.found and (seen.distance <= near or (known.near and known.felt and felt))


class ContactFinder:
    """Follows what the cameras see, and while a touch is felt, what explains it best.

    That is where cameras and residual together place it, if its force explains the residual: then J_cᵀF̂ is the torque
    that is felt, and an answer at that point is one to what is felt. What is seen at the robot counts before what is
    hidden. A hidden contact is given once frames of weight `least_weight` tell of it, while it is not ambiguous. If
    nothing explains the residual, what the cameras see counts; otherwise what is felt is left to whoever answers
    without a point.

    Parameters
    ----------
    robot : RobotModel
    params : LocalizerParameters
    fusion : FusionParameters
    """

    places = 2
    nothing = Found()
    outputs: ClassVar[Outputs] = MappingProxyType(
        {
            "contact_point": lambda known, _: known.contact,
            "second_contact_point": lambda known, stamp: known.fusion.contact(1, stamp),
            "contact_force": lambda known, _: known.fusion.force(0),
            "second_contact_force": lambda known, _: known.fusion.force(1),
            "other_mode": lambda known, stamp: contact_point(known.fusion.second, stamp),
            "other_mode_weight": lambda known, _: [known.fusion.second_weight],
            "contact_modes": lambda known, stamp: known.fusion.all_modes(stamp),
        }
    )

    def __init__(self, robot: RobotModel, params: LocalizerParameters, fusion: FusionParameters) -> None:
        self._tracker, self._gate, self._fusion = ContactTracker(robot, params), params.gate, fusion
        self._felt_tracker = ContactTracker(robot, replace(params, slide=params.felt_slide))
        self._law, self.torque_sigma = ContactFusionLaw(robot, fusion), fusion.torque_sigma

    def after(self, known: Found, views: Sequence[View], at: Instant, places: Sequence[Sequence[Place]]) -> Found:
        """Follow the nearest place of the new views and the touch that explains them and those before."""
        seen = self._tracked(known.seen, views, at, places)
        evidence = self._law.remember(known.evidence or self._law.empty(), self._law.evidence(at, views))
        fusion = self._law.decide(evidence)
        felt = self._law.felt(evidence.frames[-1])
        near = still_near(known, seen.contact, felt, self._fusion.near)
        touch, wrong = ContactTrack(), known.wrong
        if felt:
            left = self._law.unexplained(evidence, fusion)
            square = evidence.frames[-1].raised ** 2 * (left @ left) / max(len(left) - 3, 1)
            wrong = float(np.clip(wrong + _NEW * (square - wrong), 1.0, _WORST**2))
            place = self._explanation(evidence, fusion, near) or self._as_seen(seen, fusion, near)
            last = known.touch if known.felt else touch
            touch = self._felt_tracker.after(last, [place], at._replace(r=None)) if place else touch
        return Found(seen, touch, evidence, fusion, felt, near, wrong)

    def _tracked(
        self, track: ContactTrack, views: Sequence[View], at: Instant, places: Sequence[Sequence[Place]]
    ) -> ContactTrack:
        """Follow the nearest place; unless, of all cameras' `places`, only others lie at the robot."""
        nearest = min((view.places for view in views), key=_distance)
        if _distance(nearest) >= self._gate > min(map(_distance, places)):
            return track
        return self._tracker.after(track, _first(nearest), at)

    def _explanation(self, evidence: FusionMemory, fusion: Fusion, near: bool) -> Place | None:
        """Return what explains the touch best: of what is seen if it is near, unless it is hidden and unsure."""
        p = self._fusion
        if near and fusion.seen and not fusion.modes[0].seen:
            fusion = self._law.by_one(evidence, fusion, fusion.seen[0])
        mode = fusion.modes[0]
        sure = evidence.weight >= p.least_weight and fusion.second_weight <= p.ambiguous
        if not (mode.seen or sure) or not self._law.explains(evidence, fusion):
            return None
        return Place(mode.link, mode.distance if mode.seen else 0.0, mode.p_L, mode.n_L)

    def _as_seen(self, seen: ContactTrack, fusion: Fusion, near: bool) -> Place | None:
        """Return where the cameras see the contact, if the residual does not place it elsewhere."""
        contact = seen.contact
        if not contact.found or not (near or fusion.modes[0].seen):
            return None
        return Place(contact.link, contact.distance, contact.p_LC, contact.n_L)


def _first(places: Sequence[Place]) -> Sequence[Place]:
    """Return the explanations of the first place."""
    return places[: 2 if len(places) > 1 and places[1].limb else 1]


def _distance(places: Sequence[Place]) -> float:
    """Return the distance (m) of the person, ∞ without a place."""
    return min((place.distance for place in places), default=float("inf"))
