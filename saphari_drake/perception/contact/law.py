"""Where the robot is touched, from cameras and the residual together: the law behind `ContactLocalizer`.

Each candidate point of the surface has a cost (−2 log of its probability) with two parts. The residual's part, summed
over frames with a forgetting factor, is the misfit of the best force inside the friction cone. The cameras' part says
how unlikely a contact is where they look through free space, or far from everything they see of the person. Where the
cameras see the person on the surface, that point is one more candidate, with its own deviation. The best few are
refined over the surface; the best of them is the contact, the best one elsewhere the second mode.

Over frames this is a point-mass Bayes filter: a contact stays where it is on its link, so that fixed candidates all
over the surface stand for particles that need no drawing, and each frame multiplies in both measurements, with old
ones raised to a power below one. A force that lasts counts once, not anew in each frame (`again`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.primitives import Primitives
from saphari_drake.perception.camera.frames import Instant, instant
from saphari_drake.perception.camera.model import CameraParameters, pinhole
from saphari_drake.perception.contact import evidence as kernels
from saphari_drake.perception.contact.candidates import surface_candidates
from saphari_drake.perception.contact.forces import ContactForces, in_world
from saphari_drake.perception.contact.mode_search import ModeSearch
from saphari_drake.perception.contact.parameters import FusionParameters
from saphari_drake.perception.contact.places import View
from saphari_drake.perception.contact.pointing import Ray, limb_ray, limb_rays, ray_costs
from saphari_drake.perception.contact.values import NOTHING, Evidence, Fusion, FusionMemory, Mode, weighed
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]

_HOPELESS = 30.0  # a mode of the grid that costs so much more than the best one is not refined
_SHOWN = 8.0  # a mode of the grid beyond those that are refined is shown up to this cost above the best one
_CLOUD = 300  # about so many of the person's points are looked at for the distance of the candidates


class ContactFusionLaw:
    """The law with its constants.

    Parameters
    ----------
    robot : RobotModel
    params : FusionParameters
    """

    def __init__(self, robot: RobotModel, params: FusionParameters) -> None:
        self.robot, self.params = robot, params
        self.candidates = c = surface_candidates(robot, params.candidates)
        self._forces = ContactForces(robot, params)
        self._model = kernels.ForceModel(1.0, params.force_scale, params.friction, 0.4 * c.spacing, params.force_across)
        self._search = ModeSearch(robot, params, c, self._model)
        self._compile()

    def _compile(self) -> None:
        """Run every kernel once, so that no later call compiles."""
        rng, robot, x = np.random.default_rng(0), self.robot, np.ones((1, 3))
        at = instant(robot, 0.0, robot.home, rng.normal(size=robot.n) * 10.0)
        memory = self.remember(self.empty(), self.evidence(at))
        self.decide(memory)
        depth = np.ones((8, 8), np.float32)
        depth.flags.writeable = False  # as views have it
        kernels.share_free(x, x, depth, pinhole(CameraParameters(8, 8)), np.eye(3), np.zeros(3))
        kernels.nearest_distances(x, x, 0.01, *np.ones((3, 1), np.float32))
        s = robot.shapes
        limb_ray(Primitives(s.kind, s.size, s.link, s.R_LS, s.p_LS), rng.normal(size=(40, 3)) * [0.01, 0.01, 0.1])
        self._ray_cost(x, x, Ray(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.2, 0.03))
        link, normal = int(self.candidates.link[-1]), np.ones(3) / np.sqrt(3.0)
        ends = [Mode(link, sign * normal, normal, 0.0, True, 0.0, 0.01) for sign in (1.0, -1.0)]
        self._forces.pair(memory, ends, ends, ends[0])

    def empty(self) -> FusionMemory:
        """Return the memory without a contact."""
        return FusionMemory(*np.zeros((3, len(self.candidates.link))))

    def felt(self, at: Instant) -> bool:
        """Whether the residual of an instant in its deviations is more than the noise while nobody touches."""
        return at.felt(self.params.felt / at.raised)

    def in_deviations(self, at: Instant) -> Instant:
        """Return an instant with residual and joint axes over the residual's deviation.

        Jacobians are then over it too, and forces stay in N.
        """
        n, r = self.robot.n, at.r
        sigma = np.full(n, self.params.torque_sigma) if at.sigma is None else at.sigma
        motion = replace(at.motion, S=at.motion.S / sigma[:, None])
        return at._replace(motion=motion, r=np.zeros(n) if r is None else r / sigma, sigma=sigma)

    def evidence(self, at: Instant, views: Sequence[View] = ()) -> Evidence:
        """Weigh one instant with its residual (zero if there is none), and what the cameras with a frame show of it."""
        c, at = self.candidates, self.in_deviations(at)
        seen = tuple(place for view in views for place in view.places if place.distance < view.gate)
        if not self.felt(at):
            nothing = np.zeros(len(c.link))
            return Evidence(at, nothing, nothing, nothing, seen, ())
        x, a = kernels.pose_points(c.link, c.p_L, c.n_L, at.R_WL, at.p_WL)
        misfit, spread = kernels.residual_costs(self.robot.tree.parent, at.motion.S, c.link, x, a, at.r, self._model)
        rays = tuple(ray for view in views for ray in limb_rays(view))
        return Evidence(at, misfit, spread, self.vision_cost(x, a, views, rays), seen, rays)

    def vision_cost(self, x: Array, a: Array, views: Sequence[View], rays: Sequence[Ray] = ()) -> Array:
        """Return what a contact costs at surface points x with inward normals a (m, 3), by what the cameras see."""
        p, free = self.params, np.zeros(len(x))
        if not views:
            return free
        for camera, depth in ((view.camera, view.person.depth) for view in views):
            free = np.maximum(free, kernels.share_free(x, a, depth, camera.pinhole, camera.R_WC, camera.p_WC))
        points = np.concatenate([view.person.points for view in views])
        if len(points) == 0:
            return p.person_cost + p.free_cost * free
        cloud = points[:: len(points) // _CLOUD + 1].astype(np.float32).T.copy()
        distance = kernels.nearest_distances(x, a, 0.01, *cloud)
        alone = np.clip((distance - p.free_from) / (p.free_to - p.free_from), 0.0, 1.0)
        away = np.minimum((distance / p.person_scale) ** 2, p.person_cost)
        if rays:
            away = np.mean([self._ray_cost(x, a, ray) for ray in rays], axis=0)
        return away + p.free_cost * free * alone

    def _ray_cost(self, x: Array, a: Array, ray: Ray) -> Array:
        p = self.params
        return ray_costs(x, a, *ray, p.ray_sigma, p.ray_bend, p.person_cost)

    def remember(self, memory: FusionMemory, new: Evidence) -> FusionMemory:
        """Return the memory with a frame added; one without a felt contact forgets those before."""
        if not self.felt(new.at):
            memory = self.empty()
        old, weight = self.params.memory, self.params.memory * memory.weight + 1.0
        first = max(len(memory.frames) - (self.params.frames - 1), 0)
        return FusionMemory(
            old * memory.misfit + new.misfit,
            (old * memory.weight * memory.spread + new.spread) / weight,
            (old * memory.weight * memory.vision_cost + new.vision_cost) / weight,
            (*memory.frames[first:], new.at),
            (*memory.seen[first:], new.seen),
            new.rays,
            weight,
        )

    def decide(self, memory: FusionMemory) -> Fusion:
        """Return the contacts, the second mode and the forces."""
        p = self.params
        if not memory.frames:
            return NOTHING
        at, seen = memory.frames[-1], self._search.seen(memory)
        if not self.felt(at):
            chosen = [min(seen, key=lambda mode: mode.cost)] if seen else []
            return Fusion(chosen, None, 0.0, self._forces.forces(memory, chosen), chosen, np.ones(len(chosen)), chosen)
        penalty = p.unseen_cost if seen else 0.0
        cost = memory.misfit + memory.spread * (1.0 + p.again * (memory.weight - 1.0)) + memory.vision_cost + penalty
        grid = self._grid_modes(memory, cost, memory.vision_cost + penalty)
        least = min(mode.cost for mode in (*seen, *grid)) + _HOPELESS
        first, others = grid[: int(p.modes)], grid[int(p.modes) :]
        kept = [mode for mode in first if mode.cost < least]
        modes = [*seen, *self._search.refined(memory, kept), *(mode for mode in first if mode.cost >= least)]
        points = np.array([in_world(at, mode) for mode in (*modes, *others)])
        places = weighed((*modes, *others), points, p.mode_distance, p.least_mode)
        modes.sort(key=lambda mode: mode.cost)
        best = modes[0]
        here = in_world(at, best)
        second = next((m for m in modes if np.linalg.norm(here - in_world(at, m)) > p.mode_distance), None)
        weight = 0.0 if second is None else float(1.0 / (1.0 + np.exp(0.5 * min(second.cost - best.cost, 200.0))))
        own = seen[: len(memory.seen[-1])]
        anchors = [self._search.at_anchor(mode) for mode in own]
        chosen = (self._forces.pair(memory, own, anchors, best) if len(own) > 1 else []) or [best]
        seen.sort(key=lambda mode: mode.cost)
        return Fusion(chosen, second, weight, self._forces.forces(memory, chosen), *places, seen)

    def by_one(self, memory: FusionMemory, fusion: Fusion, mode: Mode) -> Fusion:
        """Return a result with one contact at a mode."""
        return fusion._replace(modes=[mode], forces=self._forces.forces(memory, [mode]))

    def explains(self, memory: FusionMemory, fusion: Fusion) -> bool:
        """Whether the forces explain the newest residual, up to its noise and a small share of it."""
        left, whole = self.unexplained(memory, fusion), np.asarray(memory.frames[-1].r)
        return bool(np.linalg.norm(left) < self.params.felt + self.params.unexplained * np.linalg.norm(whole))

    def unexplained(self, memory: FusionMemory, fusion: Fusion) -> Array:
        """Return what the forces leave of the newest residual, (n,) in deviations."""
        at = memory.frames[-1]
        left = np.asarray(at.r) - sum(at.jacobian(m.link, m.p_L).T @ F for m, F in zip(fusion.modes, fusion.forces))
        left[[m.shared for m in fusion.modes if m.shared >= 0]] = 0.0
        return np.asarray(left)

    def _grid_modes(self, memory: FusionMemory, cost: Array, prior: Array) -> list[Mode]:
        """Return the best candidates that lie apart from one another."""
        c, at = self.candidates, memory.frames[-1]
        x, a = kernels.pose_points(c.link, c.p_L, c.n_L, at.R_WL, at.p_WL)
        chosen = kernels.best_apart(cost, x, int(self.params.modes), _SHOWN, self.params.mode_distance)
        modes = [
            Mode(int(c.link[i]), c.p_L[i], c.n_L[i], float(cost[i]), False, np.inf, prior=float(prior[i]))
            for i in chosen
        ]
        if not memory.rays:
            return modes
        return [self._on_ray(mode, memory, x[i : i + 1], a[i : i + 1]) for mode, i in zip(modes, chosen)]

    def _on_ray(self, mode: Mode, memory: FusionMemory, x: Array, a: Array) -> Mode:
        """Return a mode at x with inward normal a (1, 3) that lies ahead of a limb as one that is bound to its axis."""
        p, at = self.params, memory.frames[-1]
        costs = [float(self._ray_cost(x, a, ray)[0]) for ray in memory.rays]
        ray, cost = memory.rays[int(np.argmin(costs))], min(costs)
        ahead = float((x[0] - ray.end) @ ray.u)
        if ahead <= 0.0 or cost >= p.person_cost:
            return mode
        anchor = at.motion.in_link(mode.link, ray.end + ahead * ray.u)
        sigma, along = p.ray_sigma + p.ray_bend * ahead, at.R_WL[mode.link].T @ ray.u
        return mode._replace(anchor=anchor, sigma=sigma, ray=along, prior=max(mode.prior - cost / len(costs), 0.0))
