"""Contact energies: anchors of the formula, effective mass, clamping by geometry, and the speed that is allowed."""

import numpy as np
import pytest

from saphari_drake.math.products import cholesky
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.nearness import Balls, posed, surface_of
from saphari_drake.safety.power_force.law import (
    Rule,
    contact_mass,
    contact_scale,
    effective_mass,
    heads,
    is_clamped,
    permitted_speed,
)
from saphari_drake.safety.power_force.parameters import PowerForceParameters, Structure, walls_of
from saphari_drake.safety.power_force.regions import limits_of, read_regions

REGIONS = read_regions()


def rule_of(names=("hand",), structures=(), reach=0.15):
    p = PowerForceParameters(structures=list(structures), reach=reach)
    return Rule(limits_of(REGIONS, list(names)), walls_of(p.structures), p.reach, p.clamp_gap, p.thickest, p.still)


@pytest.mark.parametrize(
    ("moving", "speed"),
    [
        (
            7.778 + 12.93 + 3.87 + 1.96 + 1.96 + 0.202,
            0.13,
        ),  # UR10e: its moving links, as its public description has them
        (3.4525 + 3.4821 + 4.05623 + 3.4822 + 2.1633 + 2.3466 + 3.129, 0.16),  # iiwa 7: the same
    ],
)
def test_a_clamped_hand_at_140_newton(moving, speed):
    """m_R = M/2 of ISO/TS 15066, A.3.5; published: 0.13 m/s for the UR10e, 0.16 m/s for the iiwa."""
    found, energy, mass = permitted_speed(limits_of(REGIONS, ["hand"]), 0.5 * moving, True)
    assert found == pytest.approx(speed, rel=0.05)
    np.testing.assert_allclose(found, 140.0 / np.sqrt(75.0e3 * 0.5 * moving))
    np.testing.assert_allclose([energy, mass], [140.0**2 / 150.0e3, 0.5 * moving])


def test_a_free_contact_shares_its_energy_with_the_person():
    free, clamped = (permitted_speed(limits_of(REGIONS, ["hand"]), 10.0, side) for side in (False, True))
    np.testing.assert_allclose(free[2], 1.0 / (1.0 / 10.0 + 1.0 / 0.6))
    np.testing.assert_allclose(free[0], np.sqrt(2.0 * 0.49 / free[2]))
    assert free[0] > 4.0 * clamped[0]
    np.testing.assert_allclose(contact_mass(1e12, 2.0, False), 2.0)


def test_the_effective_mass_is_that_of_the_task_inertia(lwr4):
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    J, L, u = terms.point(6, np.zeros(3)).Jv_WC, np.empty((7, 7)), np.array([0.6, 0.0, 0.8])
    cholesky(terms.M, L)
    np.testing.assert_allclose(effective_mass(L, u @ J), 1.0 / (u @ J @ np.linalg.inv(terms.M) @ J.T @ u))
    assert effective_mass(L, np.zeros(7)) == np.inf


def contact(lwr4, ball, v, rule, radius=0.03, head=False):
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    people = Balls(np.array([ball]), np.zeros((1, 3)), np.array([radius]))
    return contact_scale(surface_of(lwr4), terms.motion, terms.M, v, people, np.array([head]), rule)


def before_the_flange(lwr4, gap=0.0):
    """A ball beside the flange, and the velocity that turns the flange towards it."""
    p = lwr4.kinematics(lwr4.home).p_WL[6]
    return p + [0.0, 0.04 + 0.03 + gap, 0.0], np.array([1.5, 0, 0, 0, 0, 0, 0.0])


def test_at_the_permitted_scale_the_energy_is_the_limit(lwr4):
    ball, v = before_the_flange(lwr4)
    wall = [Structure([ball[0], ball[1] + 0.14, ball[2]], [1.0, 0.2, 1.0])]
    for structures in ((), wall):
        scale, energy, limit, _, clamped, *_ = contact(lwr4, ball, 3.0 * v, rule_of(structures=structures))
        assert clamped == bool(structures) and 0.0 < scale < 1.0
        np.testing.assert_allclose(scale**2 * energy, limit)
        again = contact(lwr4, ball, 3.0 * scale * v, rule_of(structures=structures))
        np.testing.assert_allclose(again[:3], [1.0, limit, limit], rtol=1e-9)


def test_a_clamped_person_allows_less(lwr4):
    ball, v = before_the_flange(lwr4)
    wall = Structure([ball[0], ball[1] + 0.14, ball[2]], [1.0, 0.2, 1.0])
    free, clamped = (contact(lwr4, ball, 3.0 * v, rule_of(structures=s))[0] for s in ((), [wall]))
    assert clamped < 0.6 * free


def test_going_away_or_far_away_is_free(lwr4):
    ball, v = before_the_flange(lwr4)
    assert contact(lwr4, ball, -3.0 * v, rule_of())[0] == 1.0
    assert contact(lwr4, ball + [0.0, 0.3, 0.0], 3.0 * v, rule_of())[0] == 1.0


def test_no_contact_is_allowed_with_a_head(lwr4):
    ball, v = before_the_flange(lwr4)
    assert contact(lwr4, ball, 0.1 * v, rule_of(), head=True)[0] == 0.0
    assert contact(lwr4, ball, 0.1 * v, rule_of(("skull",)))[0] == 0.0


def test_the_strictest_region_counts(lwr4):
    ball, v = before_the_flange(lwr4)
    scales = [contact(lwr4, ball, 6.0 * v, rule_of((name,)))[0] for name in REGIONS if REGIONS[name].transient]
    names = [name for name in REGIONS if REGIONS[name].transient]
    np.testing.assert_allclose(contact(lwr4, ball, 6.0 * v, rule_of(names))[0], min(scales))


def test_the_robot_itself_clamps(lwr4):
    """Between the flange and the upper arm, where the arm is folded; not beside the link that pushes."""
    q = np.deg2rad([0.0, 0.0, 0.0, 118.0, 0.0, 60.0, 0.0])
    motion, surface = lwr4.kinematics(q).motion, surface_of(lwr4)
    poses, s = posed(surface, motion), int(np.flatnonzero(surface.link == 6)[0])
    inward = lwr4.kinematics(q).p_WL[1] - poses[1][s]
    u = inward / np.linalg.norm(inward)
    start = poses[1][s] + 0.04 * u
    assert is_clamped(surface, poses, s, start, u, 1.0, rule_of())
    assert not is_clamped(surface, poses, s, start, -u, 1.0, rule_of())


def test_a_head_is_the_top_of_each_person():
    person = np.array([[0.0, 0.0, 1.7], [0.0, 0.1, 1.2], [0.2, 0.0, 1.0]])
    sitting = np.array([[3.0, 0.0, 1.2], [3.0, 0.0, 0.8]])
    assert heads(np.vstack([person, sitting]), np.full(5, 0.05), 0.3, 0.5).tolist() == [True, False, False, True, False]
    assert not heads(person, np.zeros(3), 0.0, 0.5).any()


@pytest.mark.parametrize(("behind", "clamps"), [(0.04, True), (0.40, False)])
def test_a_wall_clamps_whom_it_stands_behind_however_far_the_robot_is(lwr4, behind, clamps):
    """What clamps is looked for from the person on, not from the robot."""
    ball, v = before_the_flange(lwr4, 0.5)
    ahead = (ball - before_the_flange(lwr4)[0]) / 0.5
    wall = Structure(middle=(ball + (0.03 + behind) * ahead).tolist(), size=[0.06] * 3)
    assert contact(lwr4, ball, 3.0 * v, rule_of(structures=[wall], reach=0.6))[4] == clamps
