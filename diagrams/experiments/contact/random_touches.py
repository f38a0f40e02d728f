"""Random touches: posture, point, direction, force and finger, drawn so that only the finger touches the robot."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import ModelError, ParameterError
from saphari_drake.math.primitives import CAPSULE, nearest_surface_point, surface_point
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.pushing_hand import HumanHand, Push, find_target
from saphari_drake.simulation.world.hand import HandParameters

Array = NDArray[np.float64]

_DRAWS = 2000
_FLOOR = 0.08  # m, least height of what is touched


@dataclass
class RandomTouchParameters:
    """How random touches are drawn. Ranges are [low, high], uniform."""

    # Links that are touched.
    links: list[str] = field(default_factory=lambda: ["link_3", "link_4", "link_5", "link_6"])
    # deg; largest deviation of each joint from the scenario's posture, and of the push from the surface's normal.
    posture: float = 40.0
    tilt: float = 45.0
    # deg; least distance of each joint from its stops: a joint that rests on one is held there.
    stops: float = 5.0
    # N; the person pushes with so much. m; radius of the finger.
    force: list[float] = field(default_factory=lambda: [12.0, 35.0])
    finger_radius: list[float] = field(default_factory=lambda: [0.009, 0.018])
    # m; least distance of the hand, but for the finger near its tip, from the robot.
    clearance: float = 0.02
    # s; when the hand starts, how long it pushes from then on, and how long the robot is watched after the release.
    start: float = 0.3
    hold: float = 3.0
    watched: float = 2.0

    def __post_init__(self) -> None:
        require_non_negative(self, "stops")
        require_positive(self, "posture", "tilt", "force", "finger_radius", "clearance", "start", "hold", "watched")
        for name in ("force", "finger_radius"):
            value = getattr(self, name)
            if len(value) != 2 or value[0] > value[1]:
                raise ParameterError(name, f"needs [low, high], got {value}")
        if not self.links:
            raise ParameterError("links", "needs at least one")


class RandomTouch(NamedTuple):
    """One drawn touch."""

    home: list[float]  # deg; posture at the start, as a scenario takes it
    push: Push
    finger_radius: float  # m

    @property
    def q(self) -> Array:
        """The posture (n,) in rad, to the last digit that of a robot loaded with this home."""
        return np.deg2rad(self.home)


def draw_touch(robot: RobotModel, hand: HandParameters, params: RandomTouchParameters, seed: list[int]) -> RandomTouch:
    """Draw the touch of a seed; it is the same on every machine.

    Raises
    ------
    ParameterError
        If none could be drawn that touches the link and nothing else.
    """
    rng = np.random.default_rng(seed)
    name = params.links[int(rng.integers(len(params.links)))]
    link = robot.link_index(name)
    (low, high), (thin, thick) = params.force, params.finger_radius
    force, radius = rng.uniform(low, high), rng.uniform(thin, thick)
    reach, stops = np.deg2rad([params.posture, params.stops])
    for _ in range(_DRAWS):
        q = robot.home + rng.uniform(-reach, reach, robot.n)
        home = np.rad2deg(np.clip(q, robot.q_min + stops, robot.q_max - stops))
        q = np.deg2rad(home)
        terms = evaluate_dynamics(robot, q, np.zeros(robot.n))
        p_W, n_W = surface_point_of(robot, terms, link, rng)
        direction = turned(-n_W, np.deg2rad(params.tilt) * np.sqrt(rng.random()), rng)
        if p_W[2] < _FLOOR or not _clear(robot, terms, hand, radius, p_W, n_W, direction, params.clearance):
            continue
        p_L = terms.R_WL[link].T @ (p_W - terms.p_WL[link])
        push = Push(name, p_L.tolist(), direction.tolist(), [], force, params.start, params.hold)
        try:
            find_target(robot, q, push)
        except ModelError:  # another link is in the way
            continue
        return RandomTouch(home.tolist(), push, radius)
    raise ParameterError("touches", f"no touch of {name} could be drawn in {_DRAWS} tries")


def surface_point_of(
    robot: RobotModel, terms: DynamicsTerms, link: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return a random surface point (m) of a link and its outward normal, in the world."""
    shapes = robot.shapes
    R_WS, p_WS = shapes.in_world(terms.R_WL, terms.p_WL)
    s = int(rng.choice(np.flatnonzero(shapes.link == link)))
    around = rng.normal(size=3)
    around *= 0.3 / np.linalg.norm(around)
    if shapes.kind[s] == CAPSULE:
        around[2] += rng.uniform(-1.0, 1.0) * shapes.size[s, 1]
    _, p_W, n_W = surface_point(shapes.kind[s], shapes.size[s], R_WS[s], p_WS[s], p_WS[s] + R_WS[s] @ around)
    return p_W, n_W


def turned(axis: Array, angle: float, rng: np.random.Generator) -> Array:
    """Return a unit vector (3,) turned by an angle (rad) about a random axis across it."""
    side = np.cross(axis, rng.normal(size=3))
    return np.asarray(np.cos(angle) * axis + np.sin(angle) * side / np.linalg.norm(side))


def _clear(
    robot: RobotModel,
    terms: DynamicsTerms,
    hand: HandParameters,
    radius: float,
    p_W: Array,
    n_W: Array,
    direction: Array,
    clearance: float,
) -> bool:
    """Whether finger, fist and forearm, on their way to a point, keep clear of the robot and the floor elsewhere."""
    shapes, everything = robot.shapes, np.ones(robot.shapes.count, dtype=bool)
    R_WS, p_WS = shapes.in_world(terms.R_WL, terms.p_WL)
    tip = p_W + radius * n_W
    fist = hand.finger_length + 0.7 * hand.fist_radius
    parts = [(s, radius) for s in np.linspace(0.0, hand.finger_length, 8)]
    parts += [(fist + s, hand.forearm_radius) for s in np.linspace(0.0, hand.forearm_length, 8)]
    parts.append((fist, hand.fist_radius))
    for back in (0.0, HumanHand.STANDOFF):
        for s, size in parts:
            centre = tip - (s + back) * direction
            gap = nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, everything, centre)[1] - size
            near = s + back < 2.0 * radius
            if centre[2] < size or gap < (-1e-6 if near else min(clearance, 0.5 * (s + back))):
                return False
    return True
