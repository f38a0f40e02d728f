"""The contact from frame to frame: tracked where a camera sees it, by cameras and residual together where none does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import ClassVar, NamedTuple

from saphari_drake.messages import ContactPoint
from saphari_drake.perception.camera.frames import Instant
from saphari_drake.perception.contact.law import ContactFusionLaw
from saphari_drake.perception.contact.parameters import FusionParameters, LocalizerParameters
from saphari_drake.perception.contact.places import Place, View
from saphari_drake.perception.contact.track import ContactTrack, ContactTracker
from saphari_drake.perception.contact.values import NOTHING, Fusion, FusionMemory, contact_point
from saphari_drake.robots.model import RobotModel

Outputs = MappingProxyType[str, Callable[["Found", float], object]]


class Found(NamedTuple):
    """What is remembered of the frames, and what they show."""

    seen: ContactTrack = ContactTrack()
    hidden: ContactTrack = ContactTrack()
    evidence: FusionMemory | None = None
    fusion: Fusion = NOTHING
    felt: bool = False  # whether a touch is felt
    # Whether what is seen lies so near that it touches, whatever explains the residual better; or did in this touch.
    near: bool = False
    doubted: bool = False  # whether something hidden explains it better

    @property
    def contact(self) -> ContactPoint:
        """The contact: where it is seen; if only farther away, where it is hidden, if that explains more."""
        if self.near or not self.doubted:
            return self.seen.contact
        return self.hidden.contact if self.hidden.contact.found else ContactPoint(stamp=self.seen.contact.stamp)


def still_near(known: Found, seen: ContactPoint, felt: bool, near: float) -> bool:
    """Return whether what is seen touches: it is as near as `near` (m), or has been so in the touch that is felt."""
    return seen.found and (seen.distance <= near or (known.near and known.felt and felt))


class ContactFinder:
    """Follows what the cameras see, and while a touch is felt that they do not see, what explains it best.

    A hidden contact is given once frames of weight `least_weight` tell that what is seen explains less, while it is not
    ambiguous and its force explains the residual: then J_cᵀF̂ is the torque that is felt, and an answer at that point is
    one to what is felt, wherever the person is. Otherwise what is felt is left to whoever answers without a point.

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
        self._law, self.torque_sigma = ContactFusionLaw(robot, fusion), fusion.torque_sigma

    def after(self, known: Found, views: Sequence[View], at: Instant, places: Sequence[Sequence[Place]]) -> Found:
        """Follow the nearest place of the new views, and weigh them with those before."""
        seen = self._tracked(known.seen, views, at, places)
        evidence = self._law.remember(known.evidence or self._law.empty(), self._law.evidence(at, views))
        fusion = self._law.decide(evidence)
        felt = self._law.felt(evidence.frames[-1])
        near = still_near(known, seen.contact, felt, self._fusion.near)
        doubted = len(fusion.modes) > 0 and not fusion.modes[0].seen
        return Found(seen, self._hidden(known.hidden, evidence, fusion, at), evidence, fusion, felt, near, doubted)

    def _tracked(
        self, track: ContactTrack, views: Sequence[View], at: Instant, places: Sequence[Sequence[Place]]
    ) -> ContactTrack:
        """Follow the nearest place; unless, of all cameras' `places`, only others lie at the robot."""
        nearest = min((view.places for view in views), key=_distance)
        if _distance(nearest) >= self._gate > min(map(_distance, places)):
            return track
        return self._tracker.after(track, _first(nearest), at)

    def _hidden(self, track: ContactTrack, evidence: FusionMemory, fusion: Fusion, at: Instant) -> ContactTrack:
        """Follow the best explanation where no camera sees it, if it is one."""
        p, mode = self._fusion, fusion.modes[0] if fusion.modes else None
        sure = evidence.weight >= p.least_weight and fusion.second_weight <= p.ambiguous
        if mode is None or mode.seen or not (sure and self._law.explains(evidence, fusion)):
            return ContactTrack()
        place = Place(mode.link, 0.0, mode.p_L, mode.n_L)
        return self._tracker.after(track, [place], at._replace(r=None))


def _first(places: Sequence[Place]) -> Sequence[Place]:
    """Return the explanations of the first place."""
    return places[: 2 if len(places) > 1 and places[1].limb else 1]


def _distance(places: Sequence[Place]) -> float:
    """Return the distance (m) of the person, ∞ without a place."""
    return min((place.distance for place in places), default=float("inf"))
