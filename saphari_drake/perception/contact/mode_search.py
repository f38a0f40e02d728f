"""The places where a contact may be, each where its link's surface explains residual and cameras best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from saphari_drake.math.friction_cone import force_in_cone
from saphari_drake.math.primitives import Primitives
from saphari_drake.perception.camera.frames import Instant
from saphari_drake.perception.contact.candidates import SurfaceCandidates, rounded
from saphari_drake.perception.contact.evidence import ForceModel
from saphari_drake.perception.contact.forces import in_world
from saphari_drake.perception.contact.parameters import FusionParameters
from saphari_drake.perception.contact.places import Place
from saphari_drake.perception.contact.refinement import Start, refine
from saphari_drake.perception.contact.values import FusionMemory, Mode
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]

_GROUP = 2  # frames that the refinement takes as one, with their mean residual
_BORDER = 3.0  # deviations of a seen point within which another link is touched, or touched too
_BOTH = 2.0  # cost of two links at once, beside one
_CREASE = 0.005  # m; what touches two links at once does so about as near to both


class ModeSearch:
    """The search with its constants.

    Parameters
    ----------
    robot : RobotModel
    params : FusionParameters
    candidates : SurfaceCandidates
    model : ForceModel
    """

    def __init__(
        self, robot: RobotModel, params: FusionParameters, candidates: SurfaceCandidates, model: ForceModel
    ) -> None:
        self.robot, self.params, s = robot, params, robot.shapes
        self._rounded, self._touchable = rounded(s), np.unique(candidates.link).tolist()
        self._shapes = Primitives(s.kind, s.size, s.link, s.R_LS, s.p_LS)
        self._model, self._steps = model._replace(cell=0.0), candidates.spacing * np.array([0.5, 0.2, 0.08])

    def seen(self, memory: FusionMemory) -> list[Mode]:
        """Return a refined mode for each place where the newest frame sees the person on the surface.

        Behind them, those of a place that touches near the border of two links on the other one, and on both: joints up
        to the inner link feel the whole force, the outer one's joint a part of it.
        """
        p, modes, borders = self.params, list[Mode](), list[Mode]()
        for entry in memory.seen[-1]:
            anchor, _ = self.robot.shapes.nearest_on(entry.link, np.mean(self._like(entry, memory), axis=0))
            away = max(entry.distance - p.near, 0.0) / p.far
            sigma = p.vision_sigma + p.width_share * entry.width
            if entry.limb:
                sigma = p.limb_sigma + 0.5 * entry.limb_gap
            _, normal = self._rounded.nearest_on(entry.link, anchor)
            prior = away**2 + entry.cost
            modes.append(Mode(entry.link, anchor, normal, 0.0, True, entry.distance, sigma, prior, anchor, entry.limb))
            borders += self._beyond_border(memory.frames[-1], modes[-1]) if entry.distance <= p.near else []
        return self.refined(memory, [*modes, *borders])

    def _beyond_border(self, at: Instant, mode: Mode) -> list[Mode]:
        """Return a seen mode on the links next to its own that lie as near as it is known, and on both at once."""
        parent, p_W, result = self.robot.tree.parent, in_world(at, mode), list[Mode]()
        for link in self._touchable:
            if parent[link] != mode.link and parent[mode.link] != link:
                continue
            anchor = at.motion.in_link(link, p_W)
            p_L, _ = self.robot.shapes.nearest_on(link, anchor)
            if np.linalg.norm(p_L - anchor) > _BORDER * mode.sigma:
                continue
            other = mode._replace(link=link, p_L=p_L, n_L=self._rounded.nearest_on(link, p_L)[1], anchor=anchor)
            inner, outer = (mode, link) if link > mode.link else (other, mode.link)
            result += [other, inner._replace(shared=outer)]
        return result

    def _like(self, entry: Place, memory: FusionMemory) -> list[Array]:
        """Return the points (m) of an entry and of those like it, in all frames."""
        return [
            e.p_LC
            for frame in memory.seen
            for e in frame
            if e.link == entry.link
            and e.limb == entry.limb
            and np.linalg.norm(e.p_LC - entry.p_LC) < self.params.mode_distance
        ]

    def refined(self, memory: FusionMemory, modes: Sequence[Mode]) -> list[Mode]:
        """Return modes at the points of their links where they cost least, with their priors in the cost."""
        p, parent, model = self.params, self.robot.tree.parent, self._model
        window, result = memory.window(_GROUP, p.memory), []
        for mode in modes:
            anchor = mode.p_L if mode.anchor is None else mode.anchor
            start = Start(mode.link, mode.p_L, mode.n_L, anchor, mode.sigma, mode.ray)
            felt = window if mode.shared < 0 else window.without(mode.shared)
            p_L, n_L, cost = refine(parent, felt, self._shapes, self._rounded.size, start, model, p.again, self._steps)
            mode = mode._replace(p_L=p_L, n_L=n_L, cost=cost + mode.prior)
            result.append(mode if mode.shared < 0 else mode._replace(cost=mode.cost + self._share_cost(memory, mode)))
        return result

    def _share_cost(self, memory: FusionMemory, mode: Mode) -> float:
        """Return what it costs that another link takes a share of the force: all from none to the whole are as likely.

        Its joint feels the share times the torque j · F of the whole; what is outside is noise. As far as the other
        joints leave F open, so does j · F: its spread is what the outer link's is above the inner one's.
        """
        p, weight, at = self.params, memory.weights(self.params.memory), memory.frames[-1]
        r, inward = (
            weight @ np.array([frame.r for frame in memory.frames]) / weight.sum(),
            -at.R_WL[mode.link] @ mode.n_L,
        )
        J, p_W = at.jacobian(mode.link, mode.p_L), in_world(at, mode)
        p_L = at.motion.in_link(mode.shared, p_W)
        apart = np.linalg.norm(p_L - self.robot.shapes.nearest_on(mode.shared, p_L)[0]) / _CREASE
        j = at.jacobian(mode.shared, p_L)[:, mode.shared]
        usual = (np.eye(3) + (p.force_across**2 - 1.0) * np.outer(inward, inward)) / (
            p.force_scale * p.force_across
        ) ** 2
        unsure = 1.0 + j @ np.linalg.solve(J @ J.T + usual, j)
        whole = float(j @ force_in_cone(J, r, inward, p.friction, p.rcond))
        outside = r[mode.shared] - np.clip(r[mode.shared], min(whole, 0.0), max(whole, 0.0))
        spread = np.log(unsure) * (1.0 + p.again * (memory.weight - 1.0))
        return float(_BOTH + spread + weight.sum() * outside**2 / unsure + apart**2)

    def at_anchor(self, mode: Mode) -> Mode:
        """Return a seen mode where the cameras see it, before any residual has moved it."""
        p_L = mode.p_L if mode.anchor is None else mode.anchor
        return mode._replace(p_L=p_L, n_L=self._rounded.nearest_on(mode.link, p_L)[1])
