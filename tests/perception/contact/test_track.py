"""One contact over frames: hypotheses that do not flip, a residual that corrects and vetoes, borders of links."""

from __future__ import annotations

import numpy as np
import pytest

from saphari_drake.perception.camera.frames import instant
from saphari_drake.perception.contact.correction import corrected_point
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.perception.contact.places import Place, shape_costs
from saphari_drake.perception.contact.track import ContactTrack, ContactTracker
from saphari_drake.robots.dynamics import evaluate_dynamics

LINK = 4


def surface(robot, link, towards=(0.3, 0.0, 0.05)):
    return robot.shapes.nearest_on(link, np.array(towards))


def residual(robot, link, p_L, F_W):
    terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
    return terms.point(link, p_L).Jv_WC.T @ np.asarray(F_W)


def place(link, p_L, n_L, distance=0.010, gap=np.inf, cost=0.0):
    return Place(link, distance, p_L, n_L, 0.005, gap, cost)


class Frames:
    """Feeds frames at 30 Hz into a tracker of a robot at home."""

    def __init__(self, robot, **params):
        self.robot, self.track, self.count = robot, ContactTrack(), 0
        self.tracker = ContactTracker(robot, LocalizerParameters(**params))

    def show(self, *seen, r=None):
        at = instant(self.robot, self.count / 30.0, self.robot.home, r)
        self.track, self.count = self.tracker.after(self.track, seen, at), self.count + 1
        return self.track.contact


# ---- the shape of what is seen ------------------------------------------------------------------------------------


def test_a_finger_before_a_fist_is_no_limb_and_a_fist_is_one():
    """Narrow at the end of what is fitted: something thin; as wide as the limb: a limb."""
    limb, thin = shape_costs(0.13, -0.3, 0.0)
    assert thin < 1.0 and limb > 8.0
    limb, thin = shape_costs(0.5, -0.3, 0.0)
    assert limb < 1.0 and thin > 8.0


def test_only_a_limb_goes_on_to_both_sides():
    """Along the side of a limb its width decides nothing: the camera may see a narrow stripe of it."""
    limb, thin = shape_costs(0.2, 2.0, 0.0)
    assert limb == 0.0 and thin >= 16.0


def test_costs_have_no_jump():
    """A little more width or length changes the costs by little."""
    widths = np.linspace(0.0, 1.2, 2001)
    costs = np.array([shape_costs(width, 0.1, 0.2) for width in widths])
    assert np.abs(np.diff(costs, axis=0)).max() < 0.1
    costs = np.array([shape_costs(0.2, inside, 0.2) for inside in np.linspace(-1.0, 2.0, 2001)])
    assert np.abs(np.diff(costs, axis=0)).max() < 0.1


# ---- the residual --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 1.0)])
def test_residual_moves_a_seen_point_to_where_the_force_is(lwr4, side):
    """Seen 6 mm beside the truth on a link with rank to spare: at most half of it is left."""
    p_L, _ = surface(lwr4, 5)
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    F_W = terms.R_WL[5] @ np.array([-28.0, 5.0, 8.0])
    at = instant(lwr4, 0.0, lwr4.home, residual(lwr4, 5, p_L, F_W))
    seen, n_seen = lwr4.shapes.nearest_on(5, p_L + 0.006 * np.array(side) / np.linalg.norm(side))
    moved, left = corrected_point(lwr4, at, at.r, 5, seen, n_seen, 0.01, 0.004)
    assert np.linalg.norm(lwr4.shapes.nearest_on(5, moved)[0] - p_L) < 0.5 * np.linalg.norm(seen - p_L)
    assert left < 3.0


def corrected_by_chance(robot, link, torque_sigma, point_sigma):
    """Errors (m) of random points before and after the correction, and how far it moved them."""
    rng, rows = np.random.default_rng(link), []
    for _ in range(100):
        q = robot.home + rng.uniform(-0.7, 0.7, 7)
        p_L, n_L = surface(robot, link, rng.normal(size=3) * [0.3, 0.3, 0.1])
        terms = evaluate_dynamics(robot, q, np.zeros(7))
        F_W = -20.0 * (terms.R_WL[link] @ n_L) + rng.uniform(-5.0, 5.0, 3)
        r = terms.point(link, p_L).Jv_WC.T @ F_W + 0.02 * rng.normal(size=7)
        side = np.cross(n_L, rng.normal(size=3))
        seen, n_seen = robot.shapes.nearest_on(link, p_L + 0.006 * rng.normal() * side / np.linalg.norm(side))
        moved, _ = corrected_point(robot, instant(robot, 0.0, q), r, link, seen, n_seen, torque_sigma, point_sigma)
        corrected = robot.shapes.nearest_on(link, moved)[0]
        rows.append([np.linalg.norm(x) for x in (seen - p_L, corrected - p_L, moved - seen)])
    return np.array(rows).T


@pytest.mark.parametrize("link", [1, 2, 3, 4, 5])
def test_correction_helps_on_the_whole_and_never_runs_away(lwr4, link):
    """The mean error does not grow; no shift exceeds three deviations, however much the residual is trusted."""
    before, after, _ = corrected_by_chance(lwr4, link, 0.1, 0.004)
    assert np.mean(after) < 1.02 * np.mean(before)
    assert corrected_by_chance(lwr4, link, 0.005, 0.008)[2].max() <= 0.024 + 1e-9


def test_friction_in_the_residual_hardly_moves_the_point(lwr4):
    """0.4 Nm in each joint, four times what is told of the residual, of either sign; without it nothing changes."""
    p_L, n_L = surface(lwr4, 5, (0.0, 0.3, 0.0))
    F = -30.0 * (evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).R_WL[5] @ n_L)
    rng, r = np.random.default_rng(3), residual(lwr4, 5, p_L, F)
    shifts = []
    for _ in range(100):
        at = instant(lwr4, 0.0, lwr4.home, r + 0.4 * rng.choice([-1.0, 1.0], 7))
        shifts.append(np.linalg.norm(corrected_point(lwr4, at, at.r, 5, p_L, n_L, 0.1, 0.004)[0] - p_L))
    assert np.max(shifts) < 0.008 and np.mean(shifts) < 0.004


def test_point_that_explains_the_residual_stays(lwr4):
    p_L, n_L = surface(lwr4, LINK)
    at = instant(lwr4, 0.0, lwr4.home, residual(lwr4, LINK, p_L, [-20.0, 5.0, 10.0]))
    moved, left = corrected_point(lwr4, at, at.r, LINK, p_L, n_L, 0.1, 0.004)
    np.testing.assert_allclose(moved, p_L, atol=1e-9)
    assert left < 1e-6


def test_what_the_residual_does_not_show_stays_as_it_is_seen(lwr4):
    """Two joints move link 2: force and point cannot both be told from them."""
    p_L, _ = surface(lwr4, 1, (0.3, 0.02, 0.0))
    at = instant(lwr4, 0.0, lwr4.home, residual(lwr4, 1, p_L, [5.0, -20.0, 0.0]))
    seen, n_seen = lwr4.shapes.nearest_on(1, p_L + [0.0, 0.008, 0.0])
    moved, _ = corrected_point(lwr4, at, at.r, 1, seen, n_seen, 0.1, 0.004)
    assert np.linalg.norm(moved - seen) < 0.004


def test_residual_of_another_link_is_left_unexplained(lwr4):
    """A torque behind the seen link comes from elsewhere."""
    p_L, _ = surface(lwr4, 5)
    at = instant(lwr4, 0.0, lwr4.home, residual(lwr4, 5, p_L, [0.0, -25.0, 10.0]))
    inner, n_inner = surface(lwr4, 2)
    assert corrected_point(lwr4, at, at.r, 2, inner, n_inner, 0.1, 0.004)[1] > 10.0


# ---- one explanation over frames ----------------------------------------------------------------------------------


def hypotheses(robot, thin_cost, limb_cost):
    """A thin thing at the true point, and a limb 25 mm beside it."""
    p_L, n_L = surface(robot, LINK)
    beside, n_beside = robot.shapes.nearest_on(LINK, p_L + [0.0, 0.025, 0.0])
    return place(LINK, p_L, n_L, cost=thin_cost), place(LINK, beside, n_beside, gap=0.0, cost=limb_cost)


def test_one_frame_does_not_change_what_touches(lwr4):
    """Costs that flip for a frame move the point by nothing; costs that stay flipped change it."""
    frames, (thin, limb) = Frames(lwr4), hypotheses(lwr4, 0.0, 0.0)
    for k in range(12):
        odd = k % 4 == 3
        contact = frames.show(*hypotheses(lwr4, 6.0 * odd, 6.0 * (not odd)))
        np.testing.assert_allclose(contact.p_LC, thin.p_LC, atol=1e-6)
    for _ in range(60):
        contact = frames.show(*hypotheses(lwr4, 6.0, 0.0))
    np.testing.assert_allclose(contact.p_LC, limb.p_LC, atol=2e-4)


def test_residual_vetoes_the_explanation_that_looks_better(lwr4):
    """By its looks a limb, but a force there does not make this torque."""
    seen = hypotheses(lwr4, 3.0, 0.0)
    r = residual(lwr4, LINK, seen[0].p_LC, [-35.0, 20.0, 25.0])
    assert np.linalg.norm(Frames(lwr4).show(*seen).p_LC - seen[1].p_LC) < 1e-6
    felt = Frames(lwr4, torque_sigma=0.02, felt=10.0).show(*seen, r=r)
    assert np.linalg.norm(felt.p_LC - seen[0].p_LC) < 0.003


def test_point_at_the_border_of_two_links_does_not_flip(lwr4):
    """Frames that show one place on two links in turn: one link, until most of them show the other one."""
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    p_L, n_L = surface(lwr4, 4)
    p_W = terms.p_WL[4] + terms.R_WL[4] @ p_L
    q_L = terms.R_WL[5].T @ (p_W - terms.p_WL[5])
    frames, links = Frames(lwr4), []
    for k in range(40):
        seen = place(4, p_L, n_L) if k % 2 == 0 else place(5, q_L, n_L)
        links.append(frames.show(seen).link)
    assert set(links) == {4}
    assert [frames.show(place(5, q_L, n_L)).link for _ in range(12)][-1] == 5


def test_far_place_is_taken_when_it_is_seen_twice(lwr4):
    near, far = surface(lwr4, 4), surface(lwr4, 2)
    frames = Frames(lwr4)
    shown = [
        frames.show(place(link, *point)).link for link, point in ((4, near), (2, far), (4, near), (2, far), (2, far))
    ]
    assert shown == [4, 4, 4, 4, 2]


def test_what_was_seen_before_the_touch_does_not_count(lwr4):
    """A hand comes near at one place and touches 30 mm beside it: there the contact is, in the first felt frame."""
    (p_L, n_L), beside = surface(lwr4, LINK), surface(lwr4, LINK, (0.3, 0.0, 0.08))
    assert 0.015 < np.linalg.norm(beside[0] - p_L) < 0.04
    frames = Frames(lwr4)
    for _ in range(20):
        frames.show(place(LINK, *beside, distance=0.02))
    contact = frames.show(place(LINK, p_L, n_L), r=residual(lwr4, LINK, p_L, [-20.0, 5.0, 10.0]))
    np.testing.assert_allclose(contact.p_LC, p_L, atol=1e-6)


def test_nobody_near_is_no_contact(lwr4):
    frames = Frames(lwr4)
    assert frames.show(place(LINK, *surface(lwr4, LINK))).found
    assert not frames.show().found
    assert not frames.show(place(LINK, *surface(lwr4, LINK), distance=0.05)).found


def test_lost_residual_is_no_evidence(lwr4):
    """A residual that is not a number neither moves nor vetoes a point."""
    p_L, n_L = surface(lwr4, LINK)
    contact = Frames(lwr4).show(place(LINK, p_L, n_L), r=np.full(7, np.nan))
    np.testing.assert_array_equal(contact.p_LC, p_L)
