"""The fusion finds contacts that cameras see and those they do not, and says what is ambiguous."""

import numpy as np
import pytest
from experiments.localization.parameters import SceneParameters
from experiments.localization.pushes import wandering_forces
from experiments.localization.scenes import ContactScenes
from scipy.spatial.distance import cdist

from saphari_drake.math.friction_cone import cone_minimum
from saphari_drake.perception.camera.frames import instant
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact import evidence as kernels
from saphari_drake.perception.contact.candidates import surface_candidates
from saphari_drake.perception.contact.evidence import ForceModel
from saphari_drake.perception.contact.law import ContactFusionLaw
from saphari_drake.perception.contact.parameters import FusionParameters, LocalizerParameters
from saphari_drake.perception.contact.places import PlaceFinder
from saphari_drake.perception.contact.refinement import Start, Window, refine
from saphari_drake.perception.segmentation.robot_filter import RobotFilter
from saphari_drake.robots.dynamics import evaluate_dynamics


@pytest.fixture(scope="module")
def law(lwr4):
    return ContactFusionLaw(lwr4, FusionParameters(torque_sigma=0.05))


@pytest.fixture(scope="module")
def finder(lwr4):
    params = LocalizerParameters()
    return PlaceFinder(RobotFilter(lwr4.shapes, CameraParameters(), params), params)


def evidence(law, q, r, *finders_and_images):
    at = instant(law.robot, 0.0, q, r)
    return law.evidence(at, [finder.look(image, at.R_WL, at.p_WL, 2) for finder, image in finders_and_images])


@pytest.fixture(scope="module")
def scenes(lwr4):
    return ContactScenes(lwr4, [CameraParameters()], SceneParameters(hands=2))


def touched(terms, link, p_L, F):
    return terms.point(link, p_L).Jv_WC.T @ F


def at(terms, mode):
    return terms.p_WL[mode.link] + terms.R_WL[mode.link] @ mode.p_L


def push(law, q, k, tilt=0.2, size=25.0):
    """Kinematics, force and residual of a push on candidate k."""
    terms, c = evaluate_dynamics(law.robot, q, np.zeros(7)), law.candidates
    link = int(c.link[k])
    inward = -terms.R_WL[link] @ c.n_L[k]
    F = size * (inward + tilt * np.cross(inward, [0.6, 0.0, 0.8]))
    return terms, F, touched(terms, link, c.p_L[k], F)


def test_candidates_lie_evenly_on_the_surface(lwr4):
    c = surface_candidates(lwr4)
    assert 1600 < len(c.link) < 1800
    assert set(c.link) == {1, 2, 3, 4, 5, 6}
    for link in range(1, 7):
        p = c.p_L[c.link == link]
        gaps = np.sort(cdist(p, p), axis=1)[:, 1]
        assert 0.5 * c.spacing < gaps.min() and gaps.max() < 2.0 * c.spacing


def test_cost_equals_its_plain_twin(law):
    rng, c, p = np.random.default_rng(0), law.candidates, law.params
    terms, _, r = push(law, law.robot.home, 900)
    x, a = kernels.pose_points(c.link, c.p_L, c.n_L, terms.R_WL, terms.p_WL)
    cost = sum(kernels.residual_costs(terms.parent, terms.S, c.link, x, a, r, ForceModel(0.05, 30.0, 0.5, 0.0)))
    for k in [int(np.argmin(cost)), *rng.integers(len(cost), size=20)]:
        J = terms.point(int(c.link[k]), c.p_L[k]).Jv_WC
        H = J @ J.T + (0.05 / 30.0) ** 2 * np.eye(3)
        F = np.linalg.solve(H, J @ r)
        spread = np.linalg.slogdet(H / (0.05 / 30.0) ** 2)[1]
        free = (np.sum((r - J.T @ F) ** 2) + (0.05 / 30.0) ** 2 * F @ F) / 0.05**2 + spread
        along = F @ a[k]
        if along > 0.0 and np.linalg.norm(F - along * a[k]) <= p.friction * along:
            assert cost[k] == pytest.approx(free, rel=1e-6, abs=1e-3)
        else:
            assert cost[k] >= free - 1e-3


def test_refined_point_costs_no_more_than_any_near_it(law):
    """The twin: the window's cost written out, searched over a fine net of surface points around the start."""
    rng, c, p, s = np.random.default_rng(3), law.candidates, law.params, law.robot.shapes
    search = law._search
    for k in np.flatnonzero(c.link == 4)[::60]:
        terms, _, r = push(law, law.robot.home, k)
        frames = np.array([r + 0.02 * rng.normal(size=7) for _ in range(2)])
        weight, link = np.array([0.9, 1.0]), int(c.link[k])
        S, R_WL, p_WL = (np.repeat(a[None], 2, axis=0) for a in (terms.S, terms.R_WL, terms.p_WL))
        anchor = s.nearest_on(link, c.p_L[k] + 0.01 * rng.normal(size=3))[0]

        def cost(p_L, n_L, terms=terms, frames=frames, weight=weight, link=link, anchor=anchor):
            J, a = terms.point(link, p_L).Jv_WC, -terms.R_WL[link] @ n_L
            H = J @ J.T + (p.torque_sigma / p.force_scale) ** 2 * np.eye(3)
            total, F = np.sum((p_L - anchor) ** 2) / 0.005**2, np.empty(3)
            for w, r in zip(weight, frames):
                total += w * (r @ r + cone_minimum(H, J @ r, a, p.friction, F)) / p.torque_sigma**2
            spread = np.linalg.slogdet(H * (p.force_scale / p.torque_sigma) ** 2)[1]
            return total + spread * (1.0 + p.again * (np.sum(weight) - 1.0))

        model = ForceModel(p.torque_sigma, p.force_scale, p.friction, 0.0)
        found, normal, least = refine(
            terms.parent, Window(S, R_WL, p_WL, frames, weight), search._shapes, search._rounded.size,
            Start(link, c.p_L[k], c.n_L[k], anchor, 0.005, np.zeros(3)), model, p.again, search._steps,
        )  # fmt: skip
        assert least == pytest.approx(cost(found, normal), rel=1e-6, abs=1e-3)
        assert least <= cost(c.p_L[k], c.n_L[k]) + 1e-6
        net = [s.nearest_on(link, found + 0.004 * rng.normal(size=3))[0] for _ in range(60)]
        best = min(net, key=lambda q: cost(q, search._rounded.nearest_on(link, q)[1]))
        if cost(best, search._rounded.nearest_on(link, best)[1]) < least:
            assert np.linalg.norm(best - found) < 0.012  # a pattern search stops within its finest steps


def test_sharp_residual_leads_from_beside_the_contact_to_it(law):
    """Its valley is narrow and runs across the axes of a pattern: one coordinate at a time is no way along it."""
    rng, c, p, s, search = np.random.default_rng(4), law.candidates, law.params, law.robot.shapes, law._search
    errors = []
    for k in np.flatnonzero(c.link == 5)[::25]:
        terms, _, r = push(law, law.robot.home, k)
        link = int(c.link[k])
        window = Window(terms.S[None], terms.R_WL[None], terms.p_WL[None], r[None], np.ones(1))
        beside, n_L = s.nearest_on(link, c.p_L[k] + 0.008 * rng.normal(size=3))
        start = Start(link, beside, n_L, beside, 0.02, np.zeros(3))
        model = ForceModel(0.003, p.force_scale, p.friction, 0.0)
        found = refine(terms.parent, window, search._shapes, search._rounded.size, start, model, p.again, search._steps)
        errors.append(np.linalg.norm(found[0] - c.p_L[k]) / max(np.linalg.norm(beside - c.p_L[k]), 1e-3))
    assert max(errors) < 0.2


def test_share_of_free_space_equals_its_plain_twin(law, finder):
    rng, c, camera = np.random.default_rng(4), law.candidates, finder.camera
    terms = evaluate_dynamics(law.robot, law.robot.home, np.zeros(7))
    x, a = kernels.pose_points(c.link, c.p_L, c.n_L, terms.R_WL, terms.p_WL)
    depth = rng.uniform(1.0, 2.5, (480, 640)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = 0.0
    R, p = camera.R_WC, camera.p_WC
    fx, fy, cx, cy, _, _ = camera.pinhole
    free = kernels.share_free(x, a, depth, camera.pinhole, R, p)
    plain = np.zeros(len(x))
    for lift in kernels.LIFTS:
        q = (x - lift * a - p) @ R
        column, row = (q[:, :2] / q[:, 2:] * [fx, fy] + [cx, cy]).T
        inside = (q[:, 2] > 0) & (column >= 0) & (column < 640) & (row >= 0) & (row < 480)
        at = depth[np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)]
        plain += inside & (at > q[:, 2] + 0.03) & (at > 0.0)
    np.testing.assert_allclose(free, plain / len(kernels.LIFTS), atol=1e-12)
    assert 0.05 < np.mean(free > 0.0) < 1.0


def test_hidden_contact_is_found_from_the_residual_alone(law):
    """On the last links the residual shows all of the force's line."""
    rng, errors = np.random.default_rng(1), []
    for k in np.flatnonzero(law.candidates.link >= 5)[::25]:
        q = law.robot.home + rng.uniform(-0.4, 0.4, 7)
        terms, _, r = push(law, q, k)
        memory = law.empty()
        for _ in range(6):
            memory = law.remember(memory, evidence(law, q, r + 0.05 * rng.normal(size=7)))
        mode = law.decide(memory).modes[0]
        errors.append(np.linalg.norm(at(terms, mode) - terms.p_WL[law.candidates.link[k]]
                                     - terms.R_WL[law.candidates.link[k]] @ law.candidates.p_L[k]))  # fmt: skip
    assert np.median(errors) < 0.006
    assert np.mean(np.array(errors) < 0.02) > 0.8


def test_frames_with_different_forces_tell_more_than_one(law):
    rng, first, last = np.random.default_rng(2), [], []
    for k in np.flatnonzero(law.candidates.link == 3)[::40]:
        q, memory = law.robot.home + rng.uniform(-0.4, 0.4, 7), law.empty()
        for frame in range(8):
            terms, _, r = push(law, q, k, tilt=0.4 * np.sin(frame), size=25.0 + 5.0 * np.cos(2.0 * frame))
            memory = law.remember(memory, evidence(law, q, r + 0.05 * rng.normal(size=7)))
            true = terms.p_WL[3] + terms.R_WL[3] @ law.candidates.p_L[k]
            (first if frame == 0 else last if frame == 7 else []).append(
                np.linalg.norm(at(terms, law.decide(memory).modes[0]) - true)
            )
    assert np.median(last) < np.median(first)


def test_two_explanations_are_reported_as_ambiguous(law):
    """A push on link 3 without friction makes a torque that many points explain."""
    k = int(np.flatnonzero(law.candidates.link == 2)[10])
    _, _, r = push(law, law.robot.home, k, tilt=0.3)
    result = law.decide(law.remember(law.empty(), evidence(law, law.robot.home, r)))
    assert result.second is not None
    assert result.second_weight > 0.02


def test_residual_counts_by_its_measured_deviation(law):
    """All alike, it is that of the parameters; a joint that is known to be bad is not believed."""
    k = int(np.flatnonzero(law.candidates.link == 5)[20])
    _, _, r = push(law, law.robot.home, k)
    there = instant(law.robot, 0.0, law.robot.home, r)
    assumed, measured = (law.evidence(there._replace(sigma=sigma)) for sigma in (None, np.full(7, 0.05)))
    np.testing.assert_allclose(measured.misfit + measured.spread, assumed.misfit + assumed.spread)
    noisy = np.array([0.05, 0.05, 0.05, 5.0, 0.05, 0.05, 0.05])
    spoilt = there._replace(r=r + 2.0 * np.eye(7)[3])
    believed, doubted = (law.evidence(spoilt._replace(sigma=sigma)).misfit[k] for sigma in (None, noisy))
    assert believed > 10.0 > 1.0 > doubted


def test_force_that_no_contact_makes_is_not_explained(law):
    k = int(np.flatnonzero(law.candidates.link == 5)[20])
    _, _, r = push(law, law.robot.home, k)
    for residual, explained in ((r, True), (r * [1, 1, 1, 1, 1, 1, 0] + 20.0 * np.eye(7)[6], False)):
        memory = law.remember(law.empty(), evidence(law, law.robot.home, residual))
        assert law.explains(memory, law.decide(memory)) == explained


def test_weak_residual_is_no_contact(law):
    memory = law.remember(law.empty(), evidence(law, law.robot.home, np.full(7, 0.01)))
    assert law.decide(memory).modes == []
    assert law.decide(law.empty()).modes == []


def seen_touch(scenes, law, seed):
    rng = np.random.default_rng(seed)
    while True:
        touch = scenes.draw(rng, int(rng.integers(3, 6)), "finger")
        image = scenes.images([touch], touch.q)[0]
        if scenes.visible(image, 0, touch):
            terms = scenes.poses(touch.q)
            F = terms.R_WL[touch.link] @ wandering_forces(rng, touch, 1, scenes.params)[0]
            return touch, image, terms, F, touched(terms, touch.link, touch.p_L, F)


def test_seen_contact_and_force(scenes, law, finder):
    errors, force_errors = [], []
    for seed in range(8):
        touch, image, terms, F, r = seen_touch(scenes, law, seed)
        result = law.decide(law.remember(law.empty(), evidence(law, touch.q, r, (finder, image))))
        errors.append(np.linalg.norm(at(terms, result.modes[0]) - terms.p_WL[touch.link]
                                     - terms.R_WL[touch.link] @ touch.p_L))  # fmt: skip
        force_errors.append(np.linalg.norm(result.forces[0] - F) / np.linalg.norm(F))
    assert np.median(errors) < 0.006
    assert np.median(force_errors) < 0.1
