"""The laws at a contact: their closed loops, equilibria and bounds."""

import numpy as np
import pytest
from experiments.contact.force_judge import free_drift_speed
from force_loop import gains_of, simulate, spring

from saphari_drake.control.contact.law import (
    ImpedanceGains,
    contact_force_torque,
    contact_impedance_torque,
    damped,
    observable_part,
    pressing_direction,
)
from saphari_drake.control.contact.law import eased as eased_gain
from saphari_drake.control.contact.parameters import ContactImpedanceParameters
from saphari_drake.estimation.contact_force import ContactForceParameters, estimate_contact_force
from saphari_drake.math.task_space import consistent_inverse
from saphari_drake.robots.dynamics import evaluate_dynamics

M_D = np.diag([20.0, 3.0, 10.0])
MAX_MASS = ContactImpedanceParameters().max_effective_mass
RCOND = ContactForceParameters().rcond
INERTIAS = [pytest.param(None, id="natural"), pytest.param(M_D, id="chosen")]
FORCE_INERTIAS = [pytest.param([], id="natural"), pytest.param([10.0, 8.0, 12.0], id="chosen")]


def gains(M_d=None, K_N=20.0, lever=0.03):
    inverse = None if M_d is None else np.linalg.inv(M_d)
    K_p, K_d = np.diag([500.0, 400.0, 600.0]), np.diag([80.0, 60.0, 90.0])
    return ImpedanceGains(K_p, K_d, inverse, np.broadcast_to(K_N, 7), lever, MAX_MASS)


def vector(rng, length):
    """Return a vector of that length in a random direction."""
    v = rng.normal(size=3)
    return length * v / np.linalg.norm(v)


def samples(robot, links, count=40, seed=0, speed=1.0):
    """Random states in the limits, points on the surface of links, forces of 30 N and deflections of 60 mm."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        terms = evaluate_dynamics(robot, rng.uniform(robot.q_min, robot.q_max), speed * rng.uniform(-1, 1, robot.n))
        angle, link = rng.uniform(0.0, 2 * np.pi), int(rng.choice(links))
        p_LC = np.array([0.06 * np.cos(angle), 0.06 * np.sin(angle), rng.uniform(0.0, 0.2)])
        yield link, p_LC, terms, vector(rng, 30.0), vector(rng, 0.06)


def regular(point, M):
    """Whether the clipping of the effective mass is not at work."""
    return np.linalg.eigvalsh(point.Jv_WC @ np.linalg.solve(M, point.Jv_WC.T))[0] > 1.0 / MAX_MASS


def motion(terms, point, torque, F):
    """Joint and contact acceleration of M q̈ + Cq̇ + g = τ + JᵀF."""
    vdot = np.linalg.solve(terms.M, torque - terms.Cv - terms.g + point.Jv_WC.T @ F)
    return vdot, point.Jv_WC @ vdot + point.Jdotv_WC


# ---- the impedance law ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("M_d", INERTIAS)
def test_closed_loop_is_the_impedance(lwr4, M_d):
    """M_d ẍ + K_d ẋ + K_p (x − x_d) = F for an exact F̂, with M_d = Λ for the natural inertia."""
    tested, law = 0, gains(M_d)
    for link, p_LC, terms, F, e in samples(lwr4, [3, 4, 5, 6], 100):
        point = terms.point(link, p_LC)
        if not regular(point, terms.M):
            continue
        torque = contact_impedance_torque(terms, point, point.p_WC - e, F, np.zeros(7), law).total()
        _, a = motion(terms, point, torque, F)
        mass = consistent_inverse(point.Jv_WC, terms.M, MAX_MASS).Lambda if M_d is None else M_d
        np.testing.assert_allclose(mass @ a + law.K_d @ point.v_WC + law.K_p @ e, F, atol=1e-7)
        tested += 1
    assert tested > 60


def test_natural_inertia_needs_no_force_estimate(lwr4):
    """(57): the torque does not depend on F̂ when nothing is left unexplained."""
    for link, p_LC, terms, F, e in samples(lwr4, range(7)):
        point = terms.point(link, p_LC)
        with_force, without = (
            contact_impedance_torque(terms, point, point.p_WC - e, f, np.zeros(7), gains()) for f in (F, 0.0 * F)
        )
        np.testing.assert_array_equal(with_force.total(), without.total())


def test_force_term_vanishes_when_the_chosen_inertia_is_the_natural_one(lwr4):
    """Jᵀ(ΛM_d⁻¹ − I)F̂ = 0 for M_d = Λ, and the rest is that of (57)."""
    for link, p_LC, terms, F, e in samples(lwr4, [3, 4, 5, 6]):
        point = terms.point(link, p_LC)
        Lambda = consistent_inverse(point.Jv_WC, terms.M, MAX_MASS).Lambda
        shaped = contact_impedance_torque(terms, point, point.p_WC - e, F, np.zeros(7), gains(Lambda))
        natural = contact_impedance_torque(terms, point, point.p_WC - e, F, np.zeros(7), gains())
        np.testing.assert_allclose(shaped.force, 0.0, atol=1e-9)
        np.testing.assert_allclose(shaped.task, natural.task, atol=1e-8)


@pytest.mark.parametrize("M_d", INERTIAS)
def test_steady_push_deflects_by_force_over_stiffness(lwr4, M_d):
    """At rest with K_p (x − x_d) = F nothing moves: neither the contact nor the rest of the arm."""
    for link, p_LC, terms, F, _ in samples(lwr4, [3, 4, 5, 6], speed=0.0):
        point, law = terms.point(link, p_LC), gains(M_d)
        p_desired = point.p_WC - np.linalg.solve(law.K_p, F)
        torque = contact_impedance_torque(terms, point, p_desired, F, np.zeros(7), law).total()
        np.testing.assert_allclose(torque + point.Jv_WC.T @ F, terms.g, atol=1e-9)


@pytest.mark.parametrize("M_d", INERTIAS)
def test_on_the_way_back_self_motion_returns_too_and_the_contact_does_not_feel_it(lwr4, M_d):
    """q̈ along the null space is that of a critically damped posture; the contact accelerates as before."""
    for link, p_LC, terms, F, e in samples(lwr4, [5, 6]):
        point, law = terms.point(link, p_LC), gains(M_d)
        if not regular(point, terms.M):
            continue
        J, q_return = point.Jv_WC, terms.q + 0.1 * np.sin(np.arange(7.0))
        given = terms, point, point.p_WC - e, 0.0 * F, np.zeros(7), law
        away, here = (contact_impedance_torque(*given, q) for q in (q_return, terms.q))
        pull = np.linalg.solve(terms.M, away.total() - here.total())
        np.testing.assert_allclose(J @ pull, 0.0, atol=1e-9)
        P_c = consistent_inverse(J, terms.M, law.max_effective_mass).P
        np.testing.assert_allclose(pull, P_c @ (0.25 * law.K_N**2 * (q_return - terms.q)), atol=1e-9)


@pytest.mark.parametrize("M_d", INERTIAS)
def test_on_the_way_back_the_residual_is_cancelled_up_to_a_bound_and_under_a_touch_it_is_not(lwr4, M_d):
    law, r = gains(M_d)._replace(return_torque=1.0), np.array([0.4, -0.9, 3.0, -5.0, 0.0, 0.2, 1.0])
    for link, p_LC, terms, _, e in samples(lwr4, [3, 6], 20):
        point, none = terms.point(link, p_LC), np.zeros(7)
        F = np.array([1.0, -2.0, 0.5])
        given = r - point.Jv_WC.T @ F
        told, free = (
            contact_impedance_torque(terms, point, point.p_WC - e, *felt, law, terms.q)
            for felt in ((F, given), (np.zeros(3), none))
        )
        np.testing.assert_allclose(told.total() - free.total(), -np.clip(r, -1.0, 1.0), atol=1e-9)
        touched = contact_impedance_torque(terms, point, point.p_WC - e, F, given, law)
        assert np.all(np.abs(touched.misfit) <= law.misfit_lever * np.linalg.norm(F) + 1e-12)


@pytest.mark.parametrize("M_d", INERTIAS)
def test_steady_push_at_a_point_seen_wrongly(lwr4, M_d):
    """With the misfit within its lever arm the arm still rests where K_p (x − x_d) = F̂; without it, it drifts."""
    compensated = 0
    for link, p_LC, terms, F, _ in samples(lwr4, [5, 6], 100, speed=0.0):
        wrong = terms.point(link, p_LC + np.array([0.0, 0.004, 0.003]))
        r = terms.point(link, p_LC).Jv_WC.T @ F
        estimate = estimate_contact_force(wrong.Jv_WC, r, RCOND)
        law = gains(M_d)
        if estimate.rank < 3 or np.max(np.abs(estimate.misfit)) > law.misfit_lever * np.linalg.norm(estimate.F_W):
            continue
        p_desired = wrong.p_WC - np.linalg.solve(law.K_p, estimate.F_W)
        parts = contact_impedance_torque(terms, wrong, p_desired, estimate.F_W, estimate.misfit, law)
        np.testing.assert_allclose(parts.total() + r, terms.g, atol=1e-8)
        bare = contact_impedance_torque(terms, wrong, p_desired, estimate.F_W, estimate.misfit, gains(M_d, lever=0.0))
        np.testing.assert_array_equal(bare.misfit, 0.0)
        compensated += np.max(np.abs(bare.total() + r - terms.g)) > 1e-3
    assert compensated > 50


def test_misfit_is_compensated_up_to_the_lever_arm_alone(lwr4):
    """Joint by joint, and not at all without a force."""
    (link, p_LC, terms, F, e), *_ = samples(lwr4, [5], 1)
    point = terms.point(link, p_LC)
    misfit = np.array([5.0, -5.0, 0.5, -0.5, 0.0, 100.0, -0.9])
    for f, bound in ((F, 0.03 * 30.0), (0.0 * F, 0.0)):
        parts = contact_impedance_torque(terms, point, point.p_WC - e, f, misfit, gains())
        np.testing.assert_allclose(parts.misfit, np.clip(-misfit, -bound, bound))


@pytest.mark.parametrize("link", range(7))
def test_self_motion_is_damped_and_leaves_the_contact_alone(lwr4, link):
    """The null-space torque takes energy out, and accelerates the contact in no direction it can move."""
    for _, p_LC, terms, F, e in samples(lwr4, [link]):
        point = terms.point(link, p_LC)
        torque = contact_impedance_torque(terms, point, point.p_WC - e, F, np.zeros(7), gains()).null_space
        assert terms.v @ torque <= 1e-9
        P = consistent_inverse(point.Jv_WC, terms.M, MAX_MASS).P
        if np.linalg.norm(P @ terms.v) > 1e-3:
            assert terms.v @ torque < 0.0
        if regular(point, terms.M):
            np.testing.assert_allclose(point.Jv_WC @ np.linalg.solve(terms.M, torque), 0.0, atol=1e-8)


@pytest.mark.parametrize("M_d", INERTIAS)
@pytest.mark.parametrize("link", [0, 1, 2])
def test_rank_deficient_contacts_obey_the_impedance_where_they_move(lwr4, link, M_d):
    """On links 1 to 3: exact in the directions that the point can move in, no torque from the others."""
    law = gains(M_d)
    for _, p_LC, terms, F, e in samples(lwr4, [link]):
        point = terms.point(link, p_LC)
        J = point.Jv_WC
        U, s, _ = np.linalg.svd(J, full_matrices=False)
        mobility = np.linalg.eigvalsh(J @ np.linalg.solve(terms.M, J.T))
        if np.any((s > 1e-9) & (mobility[::-1] < 1.0 / MAX_MASS)):
            continue
        T = U[:, s > 1e-9] @ U[:, s > 1e-9].T
        observed = estimate_contact_force(J, J.T @ F, RCOND).F_W
        torque = contact_impedance_torque(terms, point, point.p_WC - e, observed, np.zeros(7), law).total()
        _, a = motion(terms, point, torque, F)
        spring = -law.K_p @ e - law.K_d @ point.v_WC
        if M_d is None:
            Lambda = consistent_inverse(J, terms.M, MAX_MASS).Lambda
            np.testing.assert_allclose(T @ (Lambda @ (a - (np.eye(3) - T) @ point.Jdotv_WC) - spring - F), 0, atol=1e-6)
        else:
            np.testing.assert_allclose(T @ (a - law.M_d_inv @ (spring + observed)), 0.0, atol=1e-6)


@pytest.mark.parametrize("M_d", INERTIAS)
@pytest.mark.parametrize("offset", [0.0, 0.03], ids=["exact", "30 mm off"])
@pytest.mark.parametrize("link", range(7))
def test_torque_is_bounded_at_any_contact(lwr4, link, offset, M_d):
    """Within the limits of the robot for 30 N and 60 mm, anywhere in its range, also with the point 3 cm off.

    Coriolis torques are not counted: they belong to the motion, not to the answer.
    """
    rng = np.random.default_rng(1)
    for _, p_LC, terms, F, e in samples(lwr4, [link], 300, speed=0.5):
        estimated = p_LC + vector(rng, offset)
        estimated[:2] *= 0.06 / np.linalg.norm(estimated[:2])  # a localizer names points of the surface
        point = terms.point(link, estimated)
        r = terms.point(link, p_LC).Jv_WC.T @ F
        estimate = estimate_contact_force(point.Jv_WC, r, RCOND)
        parts = contact_impedance_torque(terms, point, point.p_WC - e, estimate.F_W, estimate.misfit, gains(M_d))
        assert np.all(np.abs(parts.total() - parts.coriolis) <= lwr4.tau_max)


@pytest.mark.parametrize("link", range(3))
def test_bounded_as_a_direction_is_lost(lwr4, link):
    """Whatever the posture, no direction gets more than the largest effective mass."""
    for _, p_LC, terms, F, e in samples(lwr4, [link], 100):
        point, law = terms.point(link, p_LC), gains(M_D)
        parts = contact_impedance_torque(terms, point, point.p_WC - e, F, np.zeros(7), law)
        reach = np.linalg.norm(point.Jv_WC, 2)
        push = np.linalg.norm(law.M_d_inv @ (law.K_p @ -e - law.K_d @ point.v_WC) - point.Jdotv_WC)
        assert np.linalg.norm(parts.task) <= reach * MAX_MASS * push * (1 + 1e-9)
        assert np.linalg.norm(parts.force) <= reach * (MAX_MASS * np.linalg.norm(law.M_d_inv @ F) + np.linalg.norm(F))


def contacts(robot, links, count=60, seed=0):
    """Random states and points of links, with a force and a desired force."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        terms = evaluate_dynamics(robot, rng.uniform(robot.q_min, robot.q_max), rng.uniform(-1, 1, robot.n))
        point = terms.point(int(rng.choice(links)), np.append(rng.uniform(-0.06, 0.06, 2), rng.uniform(0.0, 0.2)))
        yield terms, point, rng.uniform(-20.0, 20.0, 3), rng.uniform(-20.0, 20.0, 3)


def mobility(terms, point):
    return point.Jv_WC @ np.linalg.solve(terms.M, point.Jv_WC.T)


def contact_acceleration(terms, point, torque, F):
    vdot = np.linalg.solve(terms.M, torque - terms.Cv - terms.g + point.Jv_WC.T @ F)
    return point.Jv_WC @ vdot + point.Jdotv_WC


# ---- the force law -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("M_d", FORCE_INERTIAS)
def test_closed_loop_of_the_force(lwr4, M_d):
    """M_d ẍ + K_d ẋ = K_f (F − F_d) for an exact F̂, with M_d = Λ for the natural inertia."""
    gains, tested = gains_of(lwr4, M_d=M_d, K_f=[4.1, 3.0, 2.0], K_d=[10.5, 20.0, 5.0], least_effective_mass=0.0), 0
    for terms, point, F, F_d in contacts(lwr4, [3, 4, 5, 6], 100):
        if np.linalg.eigvalsh(mobility(terms, point))[0] < 1.0 / MAX_MASS:
            continue
        parts, commanded = contact_force_torque(terms, point, F, F_d, np.zeros(7), gains)
        a = contact_acceleration(terms, point, parts.total(), F)
        mass = np.diag(M_d) if M_d else consistent_inverse(point.Jv_WC, terms.M, MAX_MASS).Lambda
        np.testing.assert_allclose(mass @ a + gains.K_d @ point.v_WC, gains.K_f @ (F - F_d), atol=1e-7)
        np.testing.assert_allclose(commanded, a, atol=1e-7)
        tested += 1
    assert tested > 60


@pytest.mark.parametrize("M_d", FORCE_INERTIAS)
@pytest.mark.parametrize("link", [0, 1, 2])
def test_where_a_point_cannot_move_there_is_no_torque(lwr4, link, M_d):
    """On links 1 to 3 a desired force in unobservable directions changes nothing."""
    gains = gains_of(lwr4, M_d=M_d)
    for terms, point, F, F_d in contacts(lwr4, [link]):
        estimate = estimate_contact_force(point.Jv_WC, point.Jv_WC.T @ F, RCOND)
        hidden = estimate.unobservable
        assert estimate.rank < 3
        kept = observable_part(F_d, hidden)
        np.testing.assert_allclose(hidden.T @ kept, 0.0, atol=1e-12)
        if np.linalg.norm(point.Jv_WC.T @ hidden) > 1e-9:
            continue
        whole, part = (contact_force_torque(terms, point, estimate.F_W, f, np.zeros(7), gains)[0] for f in (F_d, kept))
        np.testing.assert_allclose(hidden.T @ contact_acceleration(terms, point, part.total(), F),
                                   hidden.T @ point.Jdotv_WC, atol=1e-6)  # fmt: skip
        if not M_d:
            np.testing.assert_allclose(whole.total(), part.total(), atol=1e-6)


def test_self_motion_under_force_control_is_damped_and_leaves_the_contact_alone(lwr4):
    gains = gains_of(lwr4)
    for terms, point, F, F_d in contacts(lwr4, [3, 4, 5, 6]):
        torque = contact_force_torque(terms, point, F, F_d, np.zeros(7), gains)[0].null_space
        assert terms.v @ torque <= 1e-9
        if np.linalg.eigvalsh(mobility(terms, point))[0] > 1.0 / MAX_MASS:
            np.testing.assert_allclose(point.Jv_WC @ np.linalg.solve(terms.M, torque), 0.0, atol=1e-8)


# ---- the loop of force control with a hand -------------------------------------------------------------------------


def aligned(F):
    return 15.0 * F / max(np.linalg.norm(F), 1e-9)


@pytest.mark.parametrize("M_d", FORCE_INERTIAS)
def test_settles_at_15_N_against_a_resisting_hand(lwr4, M_d):
    """A hand of 100 N/m and 20 Ns/m: 15.00 N and a robot at rest, from a push that was weaker or stronger."""
    for F0 in (np.array([2.0, -5.0, 1.0]), np.array([-4.0, -22.0, 3.0])):
        force, velocity = simulate(lwr4, gains_of(lwr4, M_d=M_d), spring(lwr4, 100.0, 20.0, F0), aligned, 3.5)
        assert np.linalg.norm(force[-1]) == pytest.approx(15.0, abs=0.01)
        assert np.linalg.norm(velocity[-1]) < 0.005


def test_the_printed_sign_diverges(lwr4):
    """K_f (F_d − F̂) pushes ever harder into a hand that gives more than 15 N."""
    gains, hand = gains_of(lwr4)._replace(K_f=-4.1 * np.eye(3)), spring(lwr4, 100.0, 20.0, np.array([0.0, -25.0, 0.0]))
    force, velocity = simulate(lwr4, gains, hand, aligned, 0.5)
    assert np.linalg.norm(force, axis=1).max() > 60.0
    assert velocity[:, 1].max() > 1.0
    assert np.linalg.norm(simulate(lwr4, gains_of(lwr4), hand, aligned, 0.5)[0], axis=1).max() < 26.0


def test_drift_grows_as_predicted(lwr4):
    """Nobody resists: |v_y| = (K_f 15/K_d)(1 − e^{−K_d t/M_yy}), against F_d, and nothing across."""
    gains, F_d = gains_of(lwr4, M_d=[10.0, 10.0, 10.0]), np.array([0.0, 15.0, 0.0])
    _, velocity = simulate(lwr4, gains, lambda p, v: np.zeros(3), lambda F: F_d, 0.2, cycles=1)
    expected = free_drift_speed(15.0, 4.1, 10.5, 10.0, 0.001 * np.arange(200))
    np.testing.assert_allclose(-velocity[:, 1], expected, atol=0.01)
    np.testing.assert_allclose(velocity[:, [0, 2]], 0.0, atol=0.01)


def test_gains_of_a_light_contact_fall_with_its_mass():
    """Along the light direction alone; a heavy contact has the gains themselves."""
    K, R = np.diag([80.0, 60.0, 40.0]), np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert eased_gain(np.diag([0.8, 2.0, 5.0]), K, 0.8) is K
    light = R @ np.diag([0.2, 2.0, 5.0]) @ R.T
    eased = eased_gain(light, 80.0 * np.eye(3), 0.8)
    np.testing.assert_allclose(np.linalg.eigvalsh(eased), [20.0, 80.0, 80.0])
    assert np.max(np.abs(np.linalg.eigvals(np.linalg.solve(light, eased)))) <= 100.0 + 1e-9


def test_no_direction_of_a_heavy_contact_swings():
    """Damping ratio of the closed loop Λ ẍ + D ẋ + K x = 0: at least the one asked for, and K_d where that is more."""
    rng = np.random.default_rng(1)
    K_p, K_d = 500.0 * np.eye(3), 80.0 * np.eye(3)
    for _ in range(50):
        U = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        mass = 10.0 ** rng.uniform(0.0, 2.5, 3)
        Lambda = (U * mass) @ U.T
        D = damped(Lambda, K_p, K_d, 0.7)
        ratio = np.diag(U.T @ D @ U) / (2.0 * np.sqrt(500.0 * mass))
        assert np.all(ratio >= 0.7 * (1.0 - 1e-9))
        given = 80.0 / (2.0 * np.sqrt(500.0 * mass))
        np.testing.assert_allclose(ratio, np.maximum(given, 0.7))
    np.testing.assert_array_equal(damped(Lambda, K_p, K_d, 0.0), K_d)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_a_pressing_force_leans_no_farther_than_its_share(share):
    """Inside the cone the direction is that of the force; outside it is on the nearest side of the cone."""
    rng = np.random.default_rng(5)
    for F, inward in zip(rng.normal(size=(200, 3)), rng.normal(size=(200, 3))):
        inward /= np.linalg.norm(inward)
        u, along = pressing_direction(F, inward, share), inward @ F
        leaning = np.linalg.norm(F - along * inward) / along if along > 0.0 else np.inf
        np.testing.assert_allclose(np.linalg.norm(u), 1.0)
        np.testing.assert_allclose(
            np.linalg.norm(u - (u @ inward) * inward), min(leaning, share) * (u @ inward), atol=1e-12
        )
        np.testing.assert_allclose(np.linalg.det([u, inward, F]), 0.0, atol=1e-12)
        assert u @ F >= along / np.linalg.norm([1.0, share]) - 1e-12
    np.testing.assert_allclose(pressing_direction(np.array([0.0, 3.0, 4.0]), np.zeros(3), share), [0.0, 0.6, 0.8])
