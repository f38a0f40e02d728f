"""A rod on a rail that pushes the arm: the same in every engine. It needs NumPy alone, for the robot's process has no
more."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class RodParameters:
    """Where a ball on a rail touches the robot at home, and what moves it. All assumed."""

    # Link whose cover is touched, the point of it that is aimed at (m, its frame), and the direction in the world.
    link: str = "fr3_link5"
    aim: list[float] = field(default_factory=lambda: [0.0, 0.0, -0.2])
    direction: list[float] = field(default_factory=lambda: [0.0, 1.0, 0.0])
    # m, kg; the ball, and m; how far from the cover it waits.
    radius: float = 0.03
    mass: float = 1.0
    gap: float = 0.02
    # s; when it leaves, and how long it is out.
    start: float = 1.0
    hold: float = 3.0
    # m/s, m; speed and way of where it is wanted. N/m, Ns/m; spring and damper to there. N; its largest push.
    speed: float = 0.1
    travel: float = 0.3
    stiffness: float = 2000.0
    damping: float = 60.0
    force: float = 15.0


def rod_force(rod: RodParameters, time: float, s: float, v: float) -> float:
    """Return the force (N) along the rail on a rod at s (m), v (m/s): a spring to where it is wanted, with a bound."""
    since = time - rod.start
    wanted = min(rod.speed * since, rod.travel) if 0.0 <= since < rod.hold else 0.0
    pull = rod.stiffness * (wanted - s) - rod.damping * v
    return float(np.clip(pull, -5.0 * rod.force, rod.force))
