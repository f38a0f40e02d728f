"""The two ways from what the cameras and the residual show to the contact; `ContactLocalizer` takes one of them.

A way looks for so many `places` in an image, remembers what `after` returned, and starts from `nothing`; `outputs` read
its ports from what is remembered and the time of the newest frame (s).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

from saphari_drake.perception.camera.frames import Instant
from saphari_drake.perception.contact.law import ContactFusionLaw
from saphari_drake.perception.contact.parameters import FusionParameters, LocalizerParameters
from saphari_drake.perception.contact.places import Place, View
from saphari_drake.perception.contact.track import ContactTrack, ContactTracker
from saphari_drake.perception.contact.values import NOTHING, Fusion, FusionMemory, contact_point
from saphari_drake.robots.model import RobotModel

Outputs = MappingProxyType[str, Callable[[Any, float], Any]]


class Tracking:
    """The camera that sees the person nearest counts, smoothed over frames; the residual may correct and veto."""

    places = 1
    nothing = ContactTrack()
    outputs: ClassVar[Outputs] = MappingProxyType({"contact_point": lambda track, _: track.contact})

    def __init__(self, robot: RobotModel, params: LocalizerParameters) -> None:
        self._tracker, self._gate = ContactTracker(robot, params), params.gate

    def after(
        self, known: ContactTrack, views: Sequence[View], at: Instant, places: Sequence[Sequence[Place]]
    ) -> ContactTrack:
        """Follow the nearest place of the new views; unless, of all cameras' `places`, only others lie at the robot."""
        nearest = min((view.places for view in views), key=_distance)
        if _distance(nearest) >= self._gate > min(map(_distance, places)):
            return known
        return self._tracker.after(known, nearest, at)


class Fused(NamedTuple):
    """What the fusion remembers, and what it found."""

    evidence: FusionMemory | None = None
    fusion: Fusion = NOTHING


class Fusing:
    """Cameras and residual together, seen or hidden, with forces."""

    places = 2
    nothing = Fused()
    outputs: ClassVar[Outputs] = MappingProxyType(
        {
            "contact_point": lambda known, stamp: known.fusion.contact(0, stamp),
            "second_contact_point": lambda known, stamp: known.fusion.contact(1, stamp),
            "contact_force": lambda known, _: known.fusion.force(0),
            "second_contact_force": lambda known, _: known.fusion.force(1),
            "other_mode": lambda known, stamp: contact_point(known.fusion.second, stamp),
            "other_mode_weight": lambda known, _: [known.fusion.second_weight],
        }
    )

    def __init__(self, robot: RobotModel, params: FusionParameters) -> None:
        self._law = ContactFusionLaw(robot, params)

    def after(self, known: Fused, views: Sequence[View], at: Instant, places: Sequence[Sequence[Place]]) -> Fused:
        """Weigh the new views with those before."""
        evidence = self._law.remember(known.evidence or self._law.empty(), self._law.evidence(at, views))
        return Fused(evidence, self._law.decide(evidence))


def _distance(places: Sequence[Place]) -> float:
    """Return the distance (m) of the person, ∞ without a place."""
    return min((place.distance for place in places), default=float("inf"))
