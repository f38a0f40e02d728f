"""Judges a run of the contact cell: estimates against the simulation's own truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import SensorError
from saphari_drake.messages import InteractionMode
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.results import Metric, NothingToJudgeError

Array = NDArray[np.float64]
STEADY = 0.3  # s before the release that count as steady
PRESSED = 1.0  # N; a touch that is to be answered
UNANSWERED = 0.05  # share of a touch that may pass without an answer
BAND = 0.02  # a return is over when the deflection stays within this share of the steady one before the release


@dataclass(frozen=True)
class Touch:
    """One contact of the hand, from the truth.

    Attributes
    ----------
    push : Push
    onset, release, end : int
        Samples of the first and the last contact force, and the last one before the next touch.
    link : int
        Link that is touched at the release.
    p_LC : (3,) array
        Contact point at the release, fixed in that link (m).
    """

    push: Push
    onset: int
    release: int
    end: int
    link: int
    p_LC: Array


def find_touches(log: Log, robot: RobotModel, pushes: Sequence[Push]) -> list[Touch]:
    """Return the touch of each push that ends within the run.

    Raises
    ------
    NothingToJudgeError
        If no push ends within the run.
    SensorError
        If the hand never touched the robot during one.
    """
    time = log.time
    within = [push for push in pushes if push.start + push.hold <= time[-1]]
    if not within:
        first = min(push.start + push.hold for push in pushes)
        raise NothingToJudgeError(f"no push ends within {time[-1]:.3g} s, the first one does at {first:g} s")
    pressed = np.linalg.norm(log["contact_truth"][:, :3], axis=1) > 0.0
    starts = [push.start for push in pushes]
    touches = []
    for push, following in zip(within, [*starts[1:], np.inf]):
        inside = np.flatnonzero(pressed & (time >= push.start) & (time <= push.start + push.hold + 0.5))
        if len(inside) == 0:
            raise SensorError(f"the push of {push.link} at {push.start:g} s never touched the robot")
        later = np.flatnonzero(pressed & (time > following))
        end = later[0] - 1 if len(later) else len(time) - 1
        release = int(inside[-1])
        # A contact at the edge of release may be a graze: the point is that of the steady push, or of the last before.
        steadily = int(np.searchsorted(time, push.start + push.hold)) - 2
        sample = int(max(inside[inside <= steadily], default=inside[0]))
        truth = log["contact_truth"][sample]
        link, q = int(truth[6]), log["position"][sample]
        touches.append(Touch(push, int(inside[0]), release, int(end), link, in_link(robot, q, link, truth[3:6])))
    return touches


def in_link(robot: RobotModel, q: Array, link: int, p_W: Array) -> Array:
    """Return a point of the world (m) in the frame of a link."""
    return robot.kinematics(q).in_link(link, p_W)


def steady(log: Log, touch: Touch) -> NDArray[np.intp]:
    """Return the samples just before the hand is withdrawn."""
    end = touch.push.start + touch.push.hold
    return np.flatnonzero((log.time > end - STEADY) & (log.time < end - 0.01))


def force_error(log: Log, touch: Touch) -> float:
    """Return |F̂ − F| / |F| of the mean forces in the steady part."""
    rows = steady(log, touch)
    true = log["contact_truth"][rows, :3].mean(axis=0)
    return float(np.linalg.norm(log["contact_force"][rows].mean(axis=0) - true) / np.linalg.norm(true))


class Localized(NamedTuple):
    """How one touch was localized, over its samples with contact force.

    Attributes
    ----------
    errors : (k,) array
        Distance between controlled and true contact point where the controller answered one (m).
    link_right : float
        Share of these with the right link; NaN without any.
    unanswered : float
        Share of all samples in which no contact point was answered: not detected, not seen, or yielding.
    """

    errors: Array
    link_right: float
    unanswered: float

    @property
    def median(self) -> float:
        """Median error (m); infinite if the touch was never answered."""
        return float(np.median(self.errors)) if len(self.errors) else np.inf

    @property
    def p95(self) -> float:
        """Error that 95 % of the samples stay below (m); infinite if the touch was never answered."""
        return float(np.percentile(self.errors, 95)) if len(self.errors) else np.inf


def localized(log: Log, touch: Touch) -> Localized:
    """Judge the localization of one touch."""
    rows = np.arange(touch.onset, touch.release + 1)
    truth = log["contact_truth"][rows]
    pressed = np.linalg.norm(truth[:, :3], axis=1) > PRESSED
    rows, truth = rows[pressed], truth[pressed]
    active = log["active_link"][rows, 0]
    answered = (active >= 0) & (log["mode"][rows, 0] == InteractionMode.CONTACT)
    errors = np.linalg.norm(log["contact_position"][rows[answered]] - truth[answered, 3:6], axis=1)
    right = float(np.mean(active[answered] == truth[answered, 6])) if np.any(answered) else np.nan
    return Localized(errors, right, float(np.mean(~answered)))


def localization_metrics(
    log: Log, touches: Sequence[Touch], median: float = np.inf, p95: float = np.inf, answered: bool = True
) -> list[Metric]:
    """Return how well the touches were localized: the worst of them, not all pooled, and those that were not answered.

    Parameters
    ----------
    median, p95 : float
        Bounds of each touch's median and 95 % error (m).
    answered : bool
        Whether a touch that is answered too late, or not at all, decides the verdict.
    """
    found = [localized(log, touch) for touch in touches]
    return [
        Metric(
            "localization_error_m", max(f.median for f in found), "m", high=median, reported="approximate localisation"
        ),
        Metric("localization_error_p95_m", max(f.p95 for f in found), "m", high=p95),
        Metric("link_correct", min(f.link_right for f in found), "1"),
        Metric("unanswered_share", max(f.unanswered for f in found), "1", high=UNANSWERED, decides=answered),
    ]


def detection_delay(log: Log, touch: Touch) -> float:
    """Return the time from the first contact force to the detection (s); NaN if it was not detected."""
    detected = np.flatnonzero(log["contact"][touch.onset : touch.release + 1, 0] > 0.5)
    return float(log.time[touch.onset + detected[0]] - log.time[touch.onset]) if len(detected) else float("nan")


def deflection(log: Log, robot: RobotModel, touch: Touch, rows: Sequence[int] | NDArray[np.intp]) -> Array:
    """Return how far the touched point of the body is from where it was before the touch (m, world), (k, 3)."""
    before = robot.kinematics(log["position"][max(touch.onset - 1, 0)]).position(touch.link, touch.p_LC)
    return np.array([robot.kinematics(q).position(touch.link, touch.p_LC) - before for q in log["position"][rows]])


def deflection_error(log: Log, robot: RobotModel, touch: Touch, K_p: Array) -> float:
    """Return |Δx − F/K_p| / |F/K_p| of the means in the steady part, K_p (3,) in N/m."""
    rows = steady(log, touch)
    expected = log["contact_truth"][rows, :3].mean(axis=0) / K_p
    moved = deflection(log, robot, touch, rows).mean(axis=0)
    return float(np.linalg.norm(moved - expected) / np.linalg.norm(expected))


def return_time(log: Log, robot: RobotModel, touch: Touch) -> float:
    """Return the time from the release until the deflection along the push stays within 2 % of the steady one (s).

    NaN if it never does.
    """
    rows = np.arange(touch.release, touch.end + 1)
    direction = np.asarray(touch.push.direction) / np.linalg.norm(touch.push.direction)
    along = deflection(log, robot, touch, rows) @ direction
    pushed = float((deflection(log, robot, touch, steady(log, touch)) @ direction).mean())
    outside = np.flatnonzero(np.abs(along) > BAND * abs(pushed))
    if len(outside) == 0 or outside[-1] == len(rows) - 1:
        return float("nan")
    return float(log.time[rows[outside[-1]]] - log.time[touch.release])


def position_error_final(log: Log, robot: RobotModel, touch: Touch) -> float:
    """Return the deflection that is left before the next touch (m)."""
    return float(np.linalg.norm(deflection(log, robot, touch, [touch.end])))


def second_order_return_time(mass: float, damping: float, stiffness: float) -> float:
    """Return the 2 % return time of m ẍ + d ẋ + k x = 0 from rest (s)."""
    times = np.arange(0.0, 20.0, 1e-3)
    poles = np.roots([mass, damping, stiffness]).astype(complex)
    if abs(poles[0] - poles[1]) < 1e-9 * abs(poles[0]):
        x = (1.0 - poles[0] * times) * np.exp(poles[0] * times)
    else:
        x = (poles[1] * np.exp(poles[0] * times) - poles[0] * np.exp(poles[1] * times)) / (poles[1] - poles[0])
    outside = np.flatnonzero(np.abs(x.real) > BAND)
    return float(times[outside[-1]])
