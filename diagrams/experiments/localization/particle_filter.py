"""The contact particle filter of Manuelli and Tedrake (IROS 2016), joint torques alone: the second baseline.

L. Manuelli, R. Tedrake, "Localizing external contact using proprioceptive sensors: The contact particle filter", 2016.
One contact; its own management of how many contacts there are is not needed here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from experiments.localization.published import PublishedResult
from saphari_drake.math.friction_cone import force_in_cone
from saphari_drake.perception.camera.frames import Instant
from saphari_drake.perception.contact.candidates import SurfaceCandidates
from saphari_drake.perception.contact.evidence import ForceModel, pose_points, residual_costs
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]

PARTICLES = 250
STEP = 0.02  # m, deviation with which particles move over the surface from frame to frame
ANY = 1e4  # N; no force is more usual than another


def contact_particle_filter(
    robot: RobotModel,
    start: SurfaceCandidates,
    instants: Sequence[Instant],
    sigma: Array,
    friction: float,
    rng: np.random.Generator,
) -> PublishedResult:
    """Return the likeliest of the particles after the last instant.

    Particles are points of the surface, at first any of `start`. Each frame moves them, weighs them with the likelihood
    exp(−½ min ‖r − J_cᵀF‖²) over forces F in the friction cone, r and J_c in deviations `sigma` (n,) Nm, and draws
    them anew by their weights.
    """
    first = rng.integers(len(start.link), size=PARTICLES)
    link, p_L, n_L = start.link[first], start.p_L[first].copy(), start.n_L[first].copy()
    best = 0
    for k, at in enumerate(instants):
        if k > 0:
            for i in range(PARTICLES):
                p_L[i], n_L[i] = robot.shapes.nearest_on(int(link[i]), p_L[i] + STEP * rng.normal(size=3))
        p, a = pose_points(link, p_L, n_L, at.R_WL, at.p_WL)
        S, r = at.motion.S / sigma[:, None], np.asarray(at.r) / sigma
        cost = residual_costs(robot.tree.parent, S, link, p, a, r, ForceModel(1.0, ANY, friction, 0.0))[0]
        weight = np.exp(-0.5 * (cost - cost.min()))
        drawn = rng.choice(PARTICLES, PARTICLES, p=weight / weight.sum())
        link, p_L, n_L = link[drawn], p_L[drawn], n_L[drawn]
        best = int(np.argmin(cost[drawn]))
    at, chosen = instants[-1], int(link[best])
    inward = -at.R_WL[chosen] @ n_L[best]
    F = force_in_cone(at.jacobian(chosen, p_L[best]), np.asarray(at.r), inward, friction, 0.02)
    return PublishedResult(chosen, p_L[best], F)
