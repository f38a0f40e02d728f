"""One contact over frames: which explanation of what is seen holds, on which link, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from saphari_drake.messages import ContactPoint, Immutable
from saphari_drake.perception.camera.frames import Instant, instant
from saphari_drake.perception.contact.correction import corrected_point
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.perception.contact.places import Place
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]

_NO_CHOICE = 25.0  # cost of an explanation that a frame does not have
_ANOTHER_LINK = 0.7  # smoothed share of frames that must show another link at the same place before it is taken


@dataclass(frozen=True)
class ContactTrack(Immutable):
    """The contact, and what speaks for another one.

    Attributes
    ----------
    contact : ContactPoint
        Smoothed over frames.
    variance : float
        Of the contact point (m²).
    balance : float
        Cost of a limb less that of something thin, smoothed over frames.
    other_link : float
        Share of frames that show the contact on another link than its own, smoothed over frames (0–1).
    elsewhere : int
        Frames in a row that show it somewhere else.
    felt : bool
        Whether the residual showed a touch at the last frame.
    """

    contact: ContactPoint = field(default_factory=ContactPoint)
    variance: float = 0.0
    balance: float = 0.0
    other_link: float = 0.0
    elsewhere: int = 0
    felt: bool = False


class ContactTracker:
    """Follows one contact; holds constants only.

    Each frame explains what it sees as something thin, as a limb, or both (`PlaceFinder.look`). Their
    costs are compared over frames, not anew in each: what touches stays what it is. Where the robot is felt to be
    touched, each is corrected by the residual (`corrected_point`), and one that residual and image together do not
    allow costs more: the residual may veto.

    The point is that of a scalar Kalman filter of a contact that slides slowly. All starts anew when the touch is felt:
    a person who only comes near tells little about the contact. A point near the border of two links is seen now on the
    one, now on the other: it is one place, filtered as such, and stays on its link until most frames show the other
    one. A place farther away than `jump` is taken when `switch_frames` frames in a row show it.

    Parameters
    ----------
    robot : RobotModel
    params : LocalizerParameters
    """

    def __init__(self, robot: RobotModel, params: LocalizerParameters) -> None:
        self._robot, self._params = robot, params
        at = instant(robot, 0.0, robot.home, np.full(robot.n, 100.0 * params.felt * params.torque_sigma))
        link = int(robot.shapes.link.max())
        self.after(ContactTrack(), [Place(link, 0.0, *robot.shapes.nearest_on(link, np.zeros(3)))], at)  # compiles

    def after(self, track: ContactTrack, seen: Sequence[Place], at: Instant) -> ContactTrack:
        """Return the track after a frame that shows the explanations `seen` of the person's nearest place."""
        params, last = self._params, track.contact
        if all(place.distance >= params.gate for place in seen):
            return ContactTrack(ContactPoint(stamp=at.stamp))
        begins = not last.found or (self._felt(at) and not track.felt)
        weight = 1.0 if begins else -np.expm1(-(at.stamp - last.stamp) / params.time_constant)
        seen = [self._with_residual(place, at) for place in seen]
        difference = seen[1].cost - seen[0].cost if len(seen) > 1 else _NO_CHOICE
        balance = track.balance + weight * (min(max(difference, -_NO_CHOICE), _NO_CHOICE) - track.balance)
        chosen = next((place for place in seen if place.limb == (balance < 0.0)), None)
        if chosen is None:  # the limb that touches is not seen well enough in this frame
            return replace(track, contact=replace(last, stamp=at.stamp), balance=balance)
        if begins:
            return self._new(chosen, at, balance)
        return self._moved(replace(track, balance=balance), chosen, at, weight)

    def _felt(self, at: Instant) -> bool:
        """Whether the residual is more than noise."""
        return at.felt(self._params.felt * self._params.torque_sigma)

    def _with_residual(self, place: Place, at: Instant) -> Place:
        """Return a place as residual and image together explain it."""
        params, r = self._params, at.r
        if r is None or not self._felt(at):
            return place
        sigma = np.sqrt(self._variance(place))
        p_L, left = corrected_point(self._robot, at, r, place.link, place.p_LC, place.n_L, params.torque_sigma, sigma)
        p_LC, n_L = self._robot.shapes.nearest_on(place.link, p_L)
        return place._replace(p_LC=p_LC, n_L=n_L, cost=place.cost + max(left - params.veto, 0.0) ** 2)

    def _moved(self, track: ContactTrack, place: Place, at: Instant, weight: float) -> ContactTrack:
        """Return the track with its contact moved towards a place, or put there."""
        params, last = self._params, track.contact
        p_W, p_W_last = at.motion.position(place.link, place.p_LC), at.motion.position(last.link, last.p_LC)
        if np.linalg.norm(p_W - p_W_last) >= params.jump:
            if track.elsewhere + 1 < params.switch_frames:
                held = replace(last, distance=place.distance, stamp=at.stamp)
                return replace(track, contact=held, elsewhere=track.elsewhere + 1)
            return self._new(place, at, track.balance)
        share = track.other_link + weight * ((place.link != last.link) - track.other_link)
        link = place.link if share > _ANOTHER_LINK else last.link
        known = track.variance + params.slide**2 * (at.stamp - last.stamp)
        gain = known / (known + self._variance(place))
        p_W = p_W_last + gain * (p_W - p_W_last)
        p_LC, n_L = self._robot.shapes.nearest_on(link, at.motion.in_link(link, p_W))
        contact = _contact(place._replace(link=link), p_LC, n_L, at)
        share = share if link == last.link else 0.0
        return ContactTrack(contact, (1.0 - gain) * known, track.balance, share, felt=self._felt(at))

    def _new(self, place: Place, at: Instant, balance: float) -> ContactTrack:
        contact = _contact(place, place.p_LC, place.n_L, at)
        return ContactTrack(contact, self._variance(place), balance, felt=self._felt(at))

    def _variance(self, place: Place) -> float:
        """Return the variance (m²) of the contact point that a frame shows."""
        away = max(place.distance - self._params.near, 0.0)
        return self._params.point_sigma**2 + away**2


def _contact(place: Place, p_LC: Array, n_L: Array, at: Instant) -> ContactPoint:
    return ContactPoint(True, place.link, p_LC, n_L, place.distance, at.stamp)
