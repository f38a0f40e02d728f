"""Motion that shows what an arm weighs and how it rubs: sums of sines within the limits, begun at rest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.math.curves import quintic
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass
class ExcitationParameters:
    """How an arm is moved to be identified. All assumed."""

    # s; period of the motion, and how many are measured, after one in which it begins.
    period: float = 10.0
    periods: int = 2
    # Sines of each joint.
    harmonics: int = 5
    # Share (0–1) of each joint's range of positions, and of its speed, that is used; and rad (m) at most to each side.
    range_share: float = 0.5
    speed_share: float = 0.5
    reach: float = 1.0
    # m; no link's origin that rises and falls comes nearer to the floor.
    height: float = 0.2
    # Motions that are drawn; the one that tells the unknowns apart best is taken.
    trials: int = 20

    def __post_init__(self) -> None:
        require_positive(self, "period", "periods", "harmonics", "range_share", "speed_share", "reach", "trials")
        require_non_negative(self, "height")


@dataclass(frozen=True)
class Excitation:
    """A periodic motion about a posture: q(t) = q₀ + Σ a_k sin(k ω t) + b_k (cos(k ω t) − 1).

    Attributes
    ----------
    centre : (n,) array
    a, b : (h, n) arrays
        rad or m.
    period : float
        2π/ω (s).
    """

    centre: Array
    a: Array
    b: Array
    period: float

    def at(self, time: ArrayLike) -> Array:
        """Return positions (…, n) at times (…) (s); the motion grows during the first period."""
        t = np.asarray(time, dtype=float)[..., None]
        angle = 2.0 * np.pi / self.period * t[..., None] * np.arange(1, len(self.a) + 1)
        q = np.sin(angle)[..., 0, :] @ self.a + (np.cos(angle)[..., 0, :] - 1.0) @ self.b
        grown = np.vectorize(lambda share: quintic(min(max(share, 0.0), 1.0))[0])(t / self.period)
        return self.centre + grown * q

    def speed(self) -> Array:
        """Return the largest speed of each joint once it has grown (n,)."""
        t = np.linspace(0.0, self.period, 501)[:, None]
        k = 2.0 * np.pi / self.period * np.arange(1, len(self.a) + 1)
        v = (k * np.cos(k * t)) @ self.a - (k * np.sin(k * t)) @ self.b
        return np.asarray(np.abs(v).max(axis=0))


def draw_excitation(robot: RobotModel, params: ExcitationParameters, rng: np.random.Generator) -> Excitation:
    """Draw a motion about the home posture that keeps to positions, speeds and height.

    Raises
    ------
    ParameterError
        If none is found: the home posture is too near to a limit or to the floor.
    """
    low, high = (np.where(np.isfinite(x), x, robot.home + s * np.pi) for x, s in ((robot.q_min, -1), (robot.q_max, 1)))
    room = np.minimum(params.range_share * np.minimum(robot.home - low, high - robot.home), params.reach)
    if np.any(room <= 0.0):
        raise ParameterError("home", f"joint {robot.joint_names[int(np.argmin(room))]} stands at its limit")
    fastest = np.where(np.isfinite(robot.v_max), params.speed_share * robot.v_max, np.inf)
    for _ in range(200):
        a, b = rng.standard_normal((2, params.harmonics, robot.n)) / np.arange(1, params.harmonics + 1)[:, None]
        shape = Excitation(robot.home, a, b, params.period)
        times = np.linspace(params.period, 2.0 * params.period, 200)
        reached = np.abs(shape.at(times) - robot.home).max(axis=0)
        scale = np.minimum(room / reached, fastest / shape.speed())
        motion = Excitation(robot.home, scale * a, scale * b, params.period)
        heights = np.array([robot.kinematics(q).p_WL[:, 2] for q in motion.at(times[::5])])
        moved = np.ptp(heights, axis=0) > 1e-6  # the shoulder's may lie lower, and stays there
        if heights[:, moved].min(initial=np.inf) >= params.height:
            return motion
    raise ParameterError("excitation", f"no motion keeps all links {params.height} m above the floor; change home")
