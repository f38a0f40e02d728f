"""Forces at contacts, and whether the residual tells of two contacts at once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.friction_cone import expected_forces_in_cones, force_in_cone
from saphari_drake.perception.camera.frames import Instant
from saphari_drake.perception.contact.parameters import FusionParameters
from saphari_drake.perception.contact.values import FusionMemory, Mode
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class ContactForces:
    """The law of the forces with its constants.

    Parameters
    ----------
    robot : RobotModel
    params : FusionParameters
    """

    def __init__(self, robot: RobotModel, params: FusionParameters) -> None:
        self._robot, self._params = robot, params

    def forces(self, memory: FusionMemory, modes: Sequence[Mode]) -> Array:
        """Return the force of the person on the robot at each contact in the newest frame, (k, 3) N, world."""
        p, at = self._params, memory.frames[-1]
        if not modes:
            return np.zeros((0, 3))
        J, inward = self._jacobians(at, modes)
        if len(modes) == 1:
            return force_in_cone(J[0], at.r, inward[0], p.friction, p.rcond)[None]
        lasting, _ = self._lasting(memory, modes)
        s = self._deviations(at, 1.0)
        return expected_forces_in_cones(
            J / s, np.asarray(at.r) / s, inward, lasting, 1.0, p.force_along, p.force_across, p.friction
        )[0]

    def pair(self, memory: FusionMemory, seen: Sequence[Mode], at_anchors: Sequence[Mode], single: Mode) -> list[Mode]:
        """Return two seen contacts if they explain the mean residual much better together than any one alone.

        Parameters
        ----------
        memory : FusionMemory
        seen, at_anchors : sequences of Mode
            What the cameras see, as the residual has moved it, and where they see it.
        single : Mode
            The best explanation by one contact.
        """
        p, at = self._params, memory.frames[-1]
        alone = [(single,), *((mode,) for mode in seen)]
        least = min(self._lasting(memory, modes)[1] + modes[0].prior for modes in alone) - p.second_cost
        chosen: list[Mode] = []
        for i, j in combinations(range(len(seen)), 2):
            if np.linalg.norm(in_world(at, seen[i]) - in_world(at, seen[j])) < p.second_distance:
                continue
            both = [at_anchors[i], at_anchors[j]]
            forces, misfit = self._lasting(memory, both)
            misfit += both[0].prior + both[1].prior
            if misfit < least and min(np.linalg.norm(forces, axis=1)) > p.second_force:
                chosen, least = both, misfit
        return chosen

    def _jacobians(self, at: Instant, modes: Sequence[Mode]) -> tuple[Array, Array]:
        """Return Jacobians (k, 3, n) and inward normals (k, 3) of contacts."""
        inward = np.array([-at.R_WL[mode.link] @ mode.n_L for mode in modes])
        return np.array([at.jacobian(mode.link, mode.p_L) for mode in modes]), inward

    def _lasting(self, memory: FusionMemory, modes: Sequence[Mode]) -> tuple[Array, float]:
        """Return the forces (k, 3) at contacts that explain the mean residual of all frames, and their misfit."""
        p = self._params
        J, inward = self._jacobians(memory.frames[-1], modes)
        weight = memory.weights(p.memory)
        s = self._deviations(memory.frames[-1], np.sqrt(1.3 * np.sum(weight**2)) / np.sum(weight))
        mean = weight @ np.array([at.r for at in memory.frames]) / np.sum(weight)
        return expected_forces_in_cones(
            J / s, mean / s, inward, p.usual_force * inward, 1.0, p.usual_along, p.usual_across, p.friction
        )

    def _deviations(self, at: Instant, noise: float) -> Array:
        """Return the deviations (n,) of the residual's noise and of the points together, over the residual's own."""
        return np.asarray(np.hypot(noise, self._params.usual_force * self._params.vision_sigma / np.asarray(at.sigma)))


def in_world(at: Instant, mode: Mode) -> Array:
    """Return the point (3,) of a mode in the world (m)."""
    return at.motion.position(mode.link, mode.p_L)
