"""Forces at contacts, and whether the residual tells of two contacts at once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.friction_cone import expected_forces_in_cones, force_in_cone
from saphari_drake.perception.camera.frames import Instant
from saphari_drake.perception.contact.force_sizes import UsualForce, forces_of_any_size, size_costs
from saphari_drake.perception.contact.parameters import FusionParameters
from saphari_drake.perception.contact.values import FusionMemory, Mode
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]

_CORRELATED = 1.3  # variance of the residual's mean over that of independent frames


class ContactForces:
    """The law of the forces with its constants.

    Parameters
    ----------
    robot : RobotModel
    params : FusionParameters
    """

    def __init__(self, robot: RobotModel, params: FusionParameters) -> None:
        self._robot, self._params = robot, params
        sizes = np.geomspace(params.least_force, params.most_force, int(params.force_sizes))
        self._usual = UsualForce(sizes, params.usual_along, params.usual_across, params.friction)

    def forces(self, memory: FusionMemory, modes: Sequence[Mode]) -> Array:
        """Return the force of the person on the robot at each contact in the newest frame, (k, 3) N, world."""
        p, at = self._params, memory.frames[-1]
        if not modes:
            return np.zeros((0, 3))
        J, inward = self._jacobians(at, modes)
        if len(modes) == 1:
            return force_in_cone(J[0], at.r, inward[0], p.friction, p.rcond)[None]
        lasting = self._lasting(memory, modes)
        size = np.maximum(np.linalg.norm(lasting, axis=1), self._usual.sizes[0])
        s = np.hypot(1.0, np.sqrt(np.mean(size**2)) * p.vision_sigma / np.asarray(at.sigma))
        shape, _ = expected_forces_in_cones(
            J * size[:, None, None] / s,
            np.asarray(at.r) / s,
            inward,
            lasting / size[:, None],
            1.0,
            p.wander_along,
            p.wander_across,
            p.friction,
        )
        return shape * size[:, None]

    def pair(self, memory: FusionMemory, seen: Sequence[Mode], at_anchors: Sequence[Mode], single: Mode) -> list[Mode]:
        """Return two seen contacts if they explain the mean residual better together than any one alone.

        Explanations are compared by the probability that they give to it over all sizes of the forces, so that a second
        force has to be worth it, and by the odds that both places touch.

        Parameters
        ----------
        memory : FusionMemory
        seen, at_anchors : sequences of Mode
            What the cameras see, as the residual has moved it, and where they see it.
        single : Mode
            The best explanation by one contact.
        """
        p, at = self._params, memory.frames[-1]
        least = min(self._cost(memory, [mode]) for mode in (single, *seen)) + 2.0 * float(np.log(p.second_odds))
        chosen: list[Mode] = []
        for i, j in combinations(range(len(seen)), 2):
            if np.linalg.norm(in_world(at, seen[i]) - in_world(at, seen[j])) < p.second_distance:
                continue
            both = [at_anchors[i], at_anchors[j]]
            cost = self._cost(memory, both)
            if cost < least:
                chosen, least = both, cost
        if chosen and min(np.linalg.norm(self._lasting(memory, chosen), axis=1)) <= p.second_force:
            return []
        return chosen

    def _jacobians(self, at: Instant, modes: Sequence[Mode]) -> tuple[Array, Array]:
        """Return Jacobians (k, 3, n) and inward normals (k, 3) of contacts."""
        inward = np.array([-at.R_WL[mode.link] @ mode.n_L for mode in modes])
        return np.array([at.jacobian(mode.link, mode.p_L) for mode in modes]), inward

    def _lasting(self, memory: FusionMemory, modes: Sequence[Mode]) -> Array:
        """Return the forces (k, 3) at contacts that explain the mean residual of all frames."""
        J, r, inward, sigma, point = self._mean(memory, modes)
        return np.asarray(forces_of_any_size(J, r, inward, self._usual, sigma, point))

    def _cost(self, memory: FusionMemory, modes: Sequence[Mode]) -> float:
        """Return −2 log of how likely contacts make the mean residual of all frames and what the cameras see."""
        J, r, inward, sigma, point = self._mean(memory, modes)
        u = self._usual
        cost = size_costs(J, r, inward, u.sizes, u.along, u.across, sigma, point)[0]
        return float(
            -2.0 * np.logaddexp.reduce(-0.5 * cost) + 2.0 * np.log(len(cost)) + sum(m.prior + m.moved for m in modes)
        )

    def _mean(self, memory: FusionMemory, modes: Sequence[Mode]) -> tuple[Array, Array, Array, Array, Array]:
        """Return Jacobians, mean residual, inward normals, and the deviations of residual and points (n,).

        All that is of joints is over the deviations of the newest frame's residual.
        """
        p, at = self._params, memory.frames[-1]
        J, inward = self._jacobians(at, modes)
        weight = memory.weights(p.memory)
        noise = np.sqrt(_CORRELATED * np.sum(weight**2)) / np.sum(weight)
        mean = weight @ np.array([frame.r for frame in memory.frames]) / np.sum(weight)
        return J, mean, inward, np.full(len(mean), noise), p.vision_sigma / np.asarray(at.sigma)


def in_world(at: Instant, mode: Mode) -> Array:
    """Return the point (3,) of a mode in the world (m)."""
    return at.motion.position(mode.link, mode.p_L)
