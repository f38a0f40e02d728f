"""Where the robot is touched, from cameras and the residual together: the law behind `ContactFusion`.

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
from itertools import combinations

import numpy as np

from saphari_drake.math.friction_cone import expected_forces_in_cones, force_in_cone
from saphari_drake.math.tree import TreeMotion
from saphari_drake.math.tree_matrices import point_kinematics
from saphari_drake.perception.contact import evidence as kernels
from saphari_drake.perception.contact.candidates import inner_sizes, smooth_normal, surface_candidates
from saphari_drake.perception.contact.refinement import refine_all
from saphari_drake.perception.contact.values import Evidence, Fusion, FusionMemory, FusionParameters, Mode
from saphari_drake.perception.contact.vision import Array, ContactVision, Depth
from saphari_drake.robots.model import RobotModel

__all__ = ["ContactFusionLaw", "Evidence", "Fusion", "FusionMemory", "FusionParameters", "Mode"]


_HOPELESS = 30.0  # a mode of the grid that costs so much more than the best one is not refined
_GROUP = 2  # frames that the refinement takes as one, with their mean residual
_CLOUD = 300  # about so many of the person's points are looked at for the distance of the candidates


class ContactFusionLaw:
    """The law with its constants.

    Parameters
    ----------
    robot : RobotModel
    visions : sequence of ContactVision
        One a camera.
    params : FusionParameters
    """

    def __init__(self, robot: RobotModel, visions: Sequence[ContactVision], params: FusionParameters) -> None:
        self.robot, self.visions, self.params = robot, tuple(visions), params
        self.candidates = surface_candidates(robot, params.candidates)
        self._inner = inner_sizes(robot.shapes)
        self._lifts = np.array([0.006, 0.012, 0.018])
        self._steps = self.candidates.spacing * np.array([0.5, 0.2, 0.08])

    def compile(self) -> None:
        """Run every kernel once, so that no later call compiles."""
        rng, robot = np.random.default_rng(0), self.robot
        for vision in self.visions:
            images: list[Depth | None] = [None] * len(self.visions)
            images[self.visions.index(vision)] = np.full(vision.limit.shape, 0.5, dtype=np.float32)
            memory = self.remember(self.empty(), self.evidence(robot.home, rng.normal(size=robot.n) * 10.0, images))
            self.decide(memory)
        link = int(self.candidates.link[-1])
        normal = np.ones(3) / np.sqrt(3.0)
        ends = [Mode(link, sign * normal, normal, 0.0, True, 0.0, 0.01) for sign in (1.0, -1.0)]
        self._both(memory, ends, ends[0])

    def empty(self) -> FusionMemory:
        """Return the memory without a contact."""
        n, m = self.robot.n, len(self.candidates.link)
        return FusionMemory(
            np.zeros((0, n, 6)), np.zeros((0, n, 3, 3)), np.zeros((0, n, 3)), np.zeros((0, n)), *np.zeros((3, m))
        )

    def felt(self, r: Array) -> bool:
        """Whether a residual (n,) is more than noise."""
        return bool(np.linalg.norm(r) > self.params.felt * self.params.torque_sigma)

    def evidence(self, q: Array, r: Array, images: Sequence[Depth | None], least_seen: float = 0.0) -> Evidence:
        """Weigh one instant: posture q (n,), residual r (n,) and each camera's image (None: no frame).

        An image in which less than the share `least_seen` of the robot has readings counts as none.
        """
        p, c = self.params, self.candidates
        R_WL, p_WL, S, *_ = self.robot.kinematics(q).motion
        found, used = [], list(images)
        shares: dict[int, float] = {}
        for k, depth in enumerate(images):
            if depth is not None:
                places = self.visions[k].localize_several(depth, R_WL, p_WL, 2)
                shares[k] = places[0].seen
                if places[0].seen >= least_seen:
                    found.append((k, places))
                else:
                    used[k] = None
        seen = tuple(place for k, places in found for place in places if place.distance < self.visions[k].params.gate)
        points = np.concatenate([np.zeros((0, 3)), *(places[0].human_points for _, places in found)])
        m = len(c.link)
        if not self.felt(r):
            nothing = np.zeros(m)
            return Evidence(S, R_WL, p_WL, r, nothing, nothing, nothing, seen, points, shares)
        x, a = kernels.pose_points(c.link, c.p_L, c.n_L, R_WL, p_WL)
        misfit, spread = kernels.residual_costs(
            self.robot.tree.parent, S, c.link, x, a, r, p.torque_sigma, p.force_scale, p.friction, 0.4 * c.spacing
        )
        vision_cost = self._vision_cost(x, a, used, points)
        return Evidence(S, R_WL, p_WL, r, misfit, spread, vision_cost, seen, points, shares)

    def _vision_cost(self, x: Array, a: Array, images: Sequence[Depth | None], points: Array) -> Array:
        p = self.params
        if all(z is None for z in images):
            return np.zeros(len(x))
        free = np.zeros(len(x))
        for vision, depth in zip(self.visions, images):
            if depth is not None:
                R_WC, p_WC = vision.pose
                kernels.share_free(x, a, depth, R_WC, p_WC, *vision.pinhole, 0.03, self._lifts, free)
        if len(points) == 0:
            return p.person_cost + p.free_cost * free
        cloud = points[:: len(points) // _CLOUD + 1].astype(np.float32).T.copy()
        distance = kernels.nearest_distances(x, a, 0.01, cloud[0], cloud[1], cloud[2])
        alone = np.clip((distance - p.free_from) / (p.free_to - p.free_from), 0.0, 1.0)
        return np.minimum((distance / p.person_scale) ** 2, p.person_cost) + p.free_cost * free * alone

    def remember(self, memory: FusionMemory, new: Evidence) -> FusionMemory:
        """Return the memory with a frame added; one without a felt contact forgets those before."""
        if not self.felt(new.r):
            memory = self.empty()
        keep, old = self.params.frames - 1, self.params.memory
        weight = old * memory.weight + 1.0
        first = max(memory.count - keep, 0)
        return FusionMemory(
            np.concatenate([memory.S[first:], new.S[None]]),
            np.concatenate([memory.R_WL[first:], new.R_WL[None]]),
            np.concatenate([memory.p_WL[first:], new.p_WL[None]]),
            np.concatenate([memory.r[first:], new.r[None]]),
            old * memory.misfit + new.misfit,
            (old * memory.weight * memory.spread + new.spread) / weight,
            (old * memory.weight * memory.vision_cost + new.vision_cost) / weight,
            weight,
            (*memory.seen[first:], new.seen),
        )

    def decide(self, memory: FusionMemory) -> Fusion:
        """Return the contacts, the second mode and the forces."""
        p = self.params
        if memory.count == 0:
            return Fusion([], None, 0.0, np.zeros((0, 3)))
        seen = self._seen(memory)
        if not self.felt(memory.r[-1]):
            chosen = [min(seen, key=lambda mode: mode.cost)] if seen else []
            return Fusion(chosen, None, 0.0, self._forces(memory, chosen))
        penalty = p.unseen_cost if seen else 0.0
        cost = memory.misfit + memory.spread * (1.0 + p.again * (memory.weight - 1.0)) + memory.vision_cost + penalty
        grid = self._grid_modes(memory, cost)
        least = min([mode.cost for mode in (*seen, *(mode for _, mode in grid))]) + _HOPELESS
        kept = [(i, mode) for i, mode in grid if mode.cost < least]
        prior = [float(memory.vision_cost[i]) + penalty for i, _ in kept]
        modes = [*seen, *self._refined(memory, [mode for _, mode in kept], prior)]
        modes += [mode for _, mode in grid if mode.cost >= least]
        modes.sort(key=lambda mode: mode.cost)
        best = modes[0]
        second = next((mode for mode in modes if self._apart(memory, best, mode) > p.mode_distance), None)
        weight = 0.0 if second is None else float(1.0 / (1.0 + np.exp(0.5 * min(second.cost - best.cost, 200.0))))
        chosen = (self._both(memory, seen, best) if len(seen) > 1 else []) or [best]
        return Fusion(chosen, second, weight, self._forces(memory, chosen))

    def _world(self, memory: FusionMemory, mode: Mode) -> Array:
        return memory.p_WL[-1, mode.link] + memory.R_WL[-1, mode.link] @ mode.p_L

    def _apart(self, memory: FusionMemory, a: Mode, b: Mode) -> float:
        return float(np.linalg.norm(self._world(memory, a) - self._world(memory, b)))

    def _seen(self, memory: FusionMemory) -> list[Mode]:
        """Return a refined mode for each place where the newest frame sees the person on the surface."""
        modes, priors = [], []
        for entry in memory.seen[-1]:
            points = [
                e.p_LC
                for frame in memory.seen
                for e in frame
                if e.link == entry.link
                and e.limb == entry.limb
                and np.linalg.norm(e.p_LC - entry.p_LC) < self.params.mode_distance
            ]
            anchor, _ = self.visions[0].on_surface(entry.link, np.mean(points, axis=0))
            normal = smooth_normal(self.robot.shapes, entry.link, anchor)
            away = max(entry.distance - self.params.near, 0.0) / self.params.far
            sigma = self.params.vision_sigma + self.params.width_share * entry.width
            if entry.limb:
                sigma = self.params.limb_sigma + 0.5 * entry.limb_gap
            modes.append(Mode(entry.link, anchor, normal, 0.0, True, entry.distance, sigma, 0.0, anchor))
            priors.append(away**2 + entry.cost)
        return self._refined(memory, modes, priors)

    def _grid_modes(self, memory: FusionMemory, cost: Array) -> list[tuple[int, Mode]]:
        """Return the best candidates that lie apart from one another."""
        c = self.candidates
        x, _ = kernels.pose_points(c.link, c.p_L, c.n_L, memory.R_WL[-1], memory.p_WL[-1])
        chosen = kernels.best_apart(cost, x, int(self.params.modes), self.params.mode_distance)
        return [(i, Mode(int(c.link[i]), c.p_L[i], c.n_L[i], float(cost[i]), False, np.inf)) for i in chosen]

    def _refined(self, memory: FusionMemory, modes: Sequence[Mode], priors: Sequence[float]) -> list[Mode]:
        """Return modes at the points of their links where they cost least, with their priors in the cost."""
        if not modes:
            return []
        p, t, s = self.params, self.robot.tree, self.robot.shapes
        last, weight, r = memory.groups(_GROUP, p.memory)
        points, normals, costs = refine_all(
            t.parent, memory.S[last], memory.R_WL[last], memory.p_WL[last], r, weight, s.kind, s.size, self._inner,
            s.R_LS, s.p_LS, s.link, np.array([mode.link for mode in modes]), np.array([mode.p_L for mode in modes]),
            np.array([mode.n_L for mode in modes]),
            np.array([mode.p_L if mode.anchor is None else mode.anchor for mode in modes]),
            np.array([mode.sigma for mode in modes]), p.torque_sigma, p.force_scale, p.friction, p.again, self._steps,
        )  # fmt: skip
        return [
            mode._replace(p_L=points[k], n_L=normals[k], cost=float(costs[k]) + priors[k], prior=priors[k])
            for k, mode in enumerate(modes)
        ]

    def _jacobian(self, memory: FusionMemory, mode: Mode) -> Array:
        zero = np.zeros((self.robot.n, 6))
        motion = TreeMotion(memory.R_WL[-1], memory.p_WL[-1], memory.S[-1], zero, zero, self.robot.tree.parent)
        return point_kinematics(motion, mode.link, mode.p_L)[2]

    def _forces(self, memory: FusionMemory, modes: list[Mode]) -> Array:
        p, r = self.params, memory.r[-1]
        if not modes:
            return np.zeros((0, 3))
        if len(modes) > 1:
            lasting, _ = self._lasting(memory, modes)
            J, inward = self._jacobians(memory, modes)
            sigma = np.hypot(p.torque_sigma, p.usual_force * p.vision_sigma)  # noise, and the points' own deviation
            return expected_forces_in_cones(J, r, inward, lasting, sigma, p.force_along, p.force_across, p.friction)[0]
        return force_in_cone(
            self._jacobian(memory, modes[0]), r, -memory.R_WL[-1, modes[0].link] @ modes[0].n_L, p.friction, p.rcond
        )[None]

    def _jacobians(self, memory: FusionMemory, modes: Sequence[Mode]) -> tuple[Array, Array]:
        """Return Jacobians (k, 3, n) and inward normals (k, 3) of contacts in the newest frame."""
        inward = np.array([-memory.R_WL[-1, mode.link] @ mode.n_L for mode in modes])
        return np.array([self._jacobian(memory, mode) for mode in modes]), inward

    def _lasting(self, memory: FusionMemory, modes: Sequence[Mode]) -> tuple[Array, float]:
        """Return the forces (k, 3) at contacts that explain the mean residual of all frames, and their misfit."""
        p = self.params
        J, inward = self._jacobians(memory, modes)
        weight = p.memory ** np.arange(memory.count - 1, -1, -1)
        sigma = p.torque_sigma * np.sqrt(1.3 * np.sum(weight**2)) / np.sum(weight)
        sigma = np.hypot(sigma, p.usual_force * p.vision_sigma)
        mean = weight @ memory.r / np.sum(weight)
        return expected_forces_in_cones(
            J, mean, inward, p.usual_force * inward, sigma, p.usual_along, p.usual_across, p.friction
        )

    def _at_anchor(self, mode: Mode) -> Mode:
        """Return a seen mode where the cameras see it, before any residual has moved it."""
        p_L = mode.p_L if mode.anchor is None else mode.anchor
        return mode._replace(p_L=p_L, n_L=smooth_normal(self.robot.shapes, mode.link, p_L))

    def _both(self, memory: FusionMemory, seen: list[Mode], single: Mode) -> list[Mode]:
        """Return two seen contacts if they explain the mean residual much better together than any one alone."""
        p = self.params
        alone = [(single,), *((mode,) for mode in seen)]
        least = min(self._lasting(memory, modes)[1] + modes[0].prior for modes in alone) - p.second_cost
        chosen: list[Mode] = []
        for i, j in combinations(range(len(seen)), 2):
            if self._apart(memory, seen[i], seen[j]) < p.second_distance:
                continue
            pair = [self._at_anchor(seen[i]), self._at_anchor(seen[j])]
            forces, misfit = self._lasting(memory, pair)
            misfit += pair[0].prior + pair[1].prior
            if misfit < least and min(np.linalg.norm(forces, axis=1)) > p.second_force:
                chosen, least = pair, misfit
        return chosen
