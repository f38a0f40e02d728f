"""Where a person is near a robot, from one depth image: each place as something thin and as a limb explains it."""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from saphari_drake.math.primitives import Primitives, nearest_surface_point
from saphari_drake.perception.contact.limb import Limb, fit_limb, limb_contact, readings_around
from saphari_drake.perception.contact.nearest import away_from, behind_the_view, soft_minimum
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.perception.segmentation.person import Readings
from saphari_drake.perception.segmentation.robot_filter import Depth, Person, RobotFilter

Array = NDArray[np.float64]

_LIMB_READINGS = 300  # about so many are fitted
# Mean and deviation of the width of a finger and of the end of a limb, over the radius of the limb that is fitted
# around them; from random hands with fingers of 8 to 18 mm and fists of 35 to 46 mm in radius.
_THIN_WIDTH, _LIMB_WIDTH = (0.15, 0.08), (0.47, 0.10)
_MOST = 5.0  # deviations that count
_MOST_GAP = 2.0  # deviations; a limb that is farther from touching does not touch
# Radii inside the limb's extent from which, and from which on surely, it touches along its side; the cost of no limb.
_SIDE, _SIDE_COST = (0.3, 1.0), 16.0
# Ways ahead of a limb's end (m) at which something that lies so much nearer than the limb (m) hides what comes there.
_AHEAD, _BEHIND = (0.02, 0.04, 0.06), 0.02


class Place(NamedTuple):
    """One explanation of a place where the person is near the robot.

    Attributes
    ----------
    link : int
        Link that the person is nearest to.
    distance : float
        Distance there (m).
    p_LC, n_L : (3,) arrays
        Nearest surface point (m) and outward normal, in the link's frame.
    width : float
        Deviation across the view (m) of the part of the person that is near the point.
    limb_gap : float
        How far from touching a limb is that was fitted to the readings and gave the point (m; ∞: none was).
    cost : float
        −2 log of how well what is seen near the point suits this explanation of it (≥ 0).
    """

    link: int
    distance: float
    p_LC: Array
    n_L: Array
    width: float = 0.0
    limb_gap: float = np.inf
    cost: float = 0.0

    @property
    def limb(self) -> bool:
        """Whether the point is that of a fitted limb, not that of something as thick as it is wide."""
        return self.limb_gap < np.inf


class View(NamedTuple):
    """What one camera shows at one instant."""

    camera: RobotFilter
    person: Person
    places: list[Place]
    gate: float  # m; distance of the person below which a contact is possible


class _Seen(NamedTuple):
    """A place in C."""

    link: int
    distance: float
    p_C: Array
    n_C: Array
    limb_gap: float
    cost: float


def shape_costs(width: float, inside: float, gap: float) -> tuple[float, float]:
    """Return the costs (−2 log) of a limb and of something thin, by the shape of what is seen near a place.

    A fist or the end of a limb is about as wide as the limb where it touches; a finger in front of a fist is not, and
    the limb fitted to fist and forearm would touch beside it. Only a limb goes on to both sides of the place.

    Parameters
    ----------
    width : float
        Deviation across the view of what is near the place, over the limb's radius.
    inside : float
        How far the place lies inside the extent of what is seen of the limb, over its radius (< 0: beyond its end).
    gap : float
        How far the limb is from touching, in deviations.
    """
    side = float(np.clip((inside - _SIDE[0]) / (_SIDE[1] - _SIDE[0]), 0.0, 1.0))
    narrow = min(max(_LIMB_WIDTH[0] - width, 0.0) / _LIMB_WIDTH[1], _MOST)
    wide = min(max(width - _THIN_WIDTH[0], 0.0) / _THIN_WIDTH[1], _MOST)
    return gap**2 + (1.0 - side) * narrow**2, wide**2 + side * _SIDE_COST


class PlaceFinder:
    """Finds where a person is near the robot in the images of one camera; holds constants only.

    Parameters
    ----------
    camera : RobotFilter
        Takes the robot out of the camera's images.
    params : LocalizerParameters
    """

    def __init__(self, camera: RobotFilter, params: LocalizerParameters) -> None:
        self.camera, self.params = camera, params
        self._compile()

    def _compile(self) -> None:
        """Run every kernel once, so that no later call compiles."""
        s, spread = self.camera.shapes, np.random.default_rng(0).normal(size=(40, 3))
        shapes = Primitives(s.kind, s.size, s.link, s.R_LS, s.p_LS)
        readings = Readings(s.p_LS[-1] + 0.01 * spread, np.zeros(40), np.full(40, s.count - 1))
        link, _, p_C, extent = soft_minimum(readings, shapes, 6, 0.005, 0.05, 1)
        behind_the_view(shapes, link, p_C, extent, 1.5, 0.01, 0.02)
        away_from(readings, p_C, 0.1)
        limb_contact(shapes, fit_limb(readings_around(readings.point, p_C, 1.0, 40)), 0.003)

    def corrected(self, X_correct: RigidTransform) -> PlaceFinder:
        """Return this finder with its camera's pose corrected, see `RobotFilter.corrected`."""
        other = copy(self)
        other.camera = self.camera.corrected(X_correct)
        return other

    def look(self, depth: Depth, R_WL: Array, p_WL: Array, count: int = 1, apart: float = 0.12) -> View:
        """Find up to `count` places where the person is near the robot, nearest first.

        Each but the first is the nearest part of the person that lies at least `apart` (m) from the points before, all
        of them within the gate. A place has one explanation or two: something as thick as it is wide, such as a
        finger, and a limb of which the camera sees the near side. Each has the cost that its shape has; what is felt
        can tell them apart.

        Parameters
        ----------
        depth : (height, width) float32 array
            Depth image (m); 0, NaN and +inf are no reading.
        R_WL, p_WL : (n, 3, 3) and (n, 3) arrays
            Poses of the links when the image was taken.
        """
        p, camera = self.params, self.camera
        person = camera.person(depth, R_WL, p_WL)
        readings, shapes = person.readings, person.shapes
        places: list[Place] = []
        for _ in range(count):
            link, distance, p_C, extent = soft_minimum(
                readings, shapes, int(p.rank), p.softness, p.spread, int(p.rounds)
            )
            if link < 0:
                break
            link, p_CT, n_C, width = behind_the_view(
                shapes, link, p_C, extent, p.thickness, p.least_thickness, p.most_thickness
            )
            explanations = [_Seen(link, distance, p_CT, n_C, np.inf, 0.0)]
            if distance < p.limb_distance:
                explanations = self._with_limb(explanations[0], readings.point, p_C, width, shapes, depth)
            for seen in explanations:
                R_LW = R_WL[seen.link].T
                R_LC = R_LW @ camera.R_WC
                p_LC = R_LC @ seen.p_C + R_LW @ (camera.p_WC - p_WL[seen.link])
                n_L = R_LC @ seen.n_C
                places.append(Place(seen.link, seen.distance, p_LC, n_L, width, seen.limb_gap, seen.cost))
            if distance > p.gate:
                break
            readings = away_from(readings, p_C, apart)
        return View(camera, person, places, p.gate)

    def _with_limb(
        self, thin: _Seen, readings: Array, p_C: Array, width: float, shapes: Primitives, depth: Depth
    ) -> list[_Seen]:
        """Return the explanation as something thin, and that as a limb around p_C if one suits the readings.

        What is seen of a limb may end because it goes on behind something: then it does not touch where it ends.
        """
        p = self.params
        cloud = readings_around(readings, p_C, p.limb_reach, _LIMB_READINGS)
        if len(cloud) < p.component:
            return [thin]
        limb: Limb = fit_limb(cloud)
        if limb.radius < p.limb_radius:
            return [thin]
        link, p_CT, d = limb_contact(shapes, limb, p.limb_softness)
        gap = d - limb.radius
        if abs(gap) > _MOST_GAP * p.limb_gap or np.sum((p_CT - p_C) ** 2) > p.limb_reach**2:
            return [thin]
        if self._goes_on_behind(limb, p_CT, depth):
            return [thin]
        along = float((p_C - limb.c) @ limb.u)
        inside = min(along - limb.first, limb.last - along) / limb.radius
        cost, thin_cost = shape_costs(width / limb.radius, inside, gap / p.limb_gap)
        kind, size, links, R_CS, p_CS = shapes
        _, _, p_CT, n_C = nearest_surface_point(kind, size, R_CS, p_CS, links == link, p_CT)
        return [thin._replace(cost=thin_cost), _Seen(link, max(gap, 0.0), p_CT, n_C, abs(gap), cost)]

    def _goes_on_behind(self, limb: Limb, p_CT: Array, depth: Depth) -> bool:
        """Whether a limb that touches with its end, at p_CT, is lost to view there behind something nearer."""
        along, pinhole = float((p_CT - limb.c) @ limb.u), self.camera.pinhole
        if limb.first + _SIDE[0] * limb.radius < along < limb.last - _SIDE[0] * limb.radius:
            return False
        end, outward = (limb.first, -1.0) if along < 0.5 * (limb.first + limb.last) else (limb.last, 1.0)
        nearer = 0
        for way in _AHEAD:
            x, y, z = limb.c + (end + outward * way) * limb.u
            column, row = int(x / z * pinhole.fx + pinhole.cx), int(y / z * pinhole.fy + pinhole.cy)
            if 0 <= row < depth.shape[0] and 0 <= column < depth.shape[1]:
                nearer += 0.0 < depth[row, column] < z - limb.radius - _BEHIND
        return nearer >= 2
