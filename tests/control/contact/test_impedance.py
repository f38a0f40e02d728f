"""The contact impedance: its closed loop, equilibria, bounds, and changes of mode without jumps."""

from dataclasses import replace

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.control.contact.impedance import (
    ContactImpedanceController,
    ContactImpedanceParameters,
    ImpedanceGains,
    contact_impedance_torque,
)
from saphari_drake.control.contact.terms import TorqueTerms, posture_torque
from saphari_drake.errors import ParameterError, StateError
from saphari_drake.estimation.contact_force import ContactForceParameters, estimate_contact_force
from saphari_drake.math.saturation import limit_torque
from saphari_drake.math.task_space import consistent_inverse
from saphari_drake.messages import ContactPoint, Interaction, InteractionMode
from saphari_drake.robots.dynamics import evaluate_dynamics, point_position

HOLD, CONTACT, RETURN, YIELD, STOP = InteractionMode
M_D = np.diag([20.0, 3.0, 10.0])
MAX_MASS = ContactImpedanceParameters().max_effective_mass
RCOND = ContactForceParameters().rcond
INERTIAS = [pytest.param(None, id="natural"), pytest.param(M_D, id="chosen")]


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


# ---- the law -------------------------------------------------------------------------------------------------------


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


def test_posture_torque_is_computed_torque(lwr4):
    """q̈ = K (q_d − q) − D q̇, each joint for itself, the light wrist included."""
    K, D = np.linspace(100.0, 250.0, 7), np.linspace(10.0, 30.0, 7)
    for _, _, terms, _, _ in samples(lwr4, [0], 10):
        torque = posture_torque(terms, lwr4.home, K, D).total()
        vdot = np.linalg.solve(terms.M, torque - terms.Cv - terms.g)
        np.testing.assert_allclose(vdot, K * (lwr4.home - terms.q) - D * terms.v, atol=1e-6)


def test_limits_cut_and_report():
    torque, excess = limit_torque(np.array([5.0, -5.0, 1.0]), np.array([3.0, 4.0, 2.0]))
    np.testing.assert_array_equal(torque, [3.0, -4.0, 1.0])
    np.testing.assert_array_equal(excess, [2.0, -1.0, 0.0])


def test_torque_that_is_not_a_number_is_refused():
    """Clipping alone would pass it on to the joints."""
    with pytest.raises(StateError, match="torque"):
        limit_torque(np.array([1.0, np.nan]), np.ones(2))


# ---- the system ----------------------------------------------------------------------------------------------------


class Controlled(Bench):
    """A controller with a robot whose state is set by hand."""

    def __init__(self, robot, q=None, v=None, **params):
        self.robot = robot
        self.q = robot.home if q is None else q
        self.v = np.zeros(7) if v is None else v
        super().__init__(
            ContactImpedanceController(robot, ContactImpedanceParameters(**params)),
            dynamics=evaluate_dynamics(robot, self.q, self.v),
            interaction=self.mode(HOLD),
            contact_force=np.zeros(3),
            misfit=np.zeros(7),
        )

    def mode(self, mode, onset=0, link=5):
        """An interaction whose posture was latched at home."""
        answered = mode in (CONTACT, RETURN)
        point = ContactPoint(found=True, link=link, p_LC=np.array([0.05, 0.0, 0.06])) if answered else ContactPoint()
        return Interaction(mode, point, self.robot.home, onset)

    @property
    def terms(self):
        return TorqueTerms(*self.read("torque_terms").reshape(-1, 7))

    @property
    def torque(self):
        return self.read("torque_commanded")


@pytest.fixture
def moving(lwr4):
    """A robot a little away from its latched posture, in motion, in each mode that is asked for."""
    rng = np.random.default_rng(2)
    q, v = lwr4.home + rng.uniform(-0.05, 0.05, 7), rng.uniform(-0.3, 0.3, 7)

    def start(mode, **params):
        bench = Controlled(lwr4, q, v, **params)
        bench.set(interaction=bench.mode(mode), contact_force=[5.0, -8.0, 3.0], misfit=0.1 * np.ones(7))
        return bench

    return start


def power(bench, torque):
    """Power of a torque beside gravity, which stores it, and Coriolis forces, which turn it."""
    terms = bench.terms
    return bench.v @ (torque - terms.gravity - terms.coriolis)


@pytest.mark.parametrize("mode", [YIELD, STOP])
def test_yielding_and_stopping_are_passive(moving, mode):
    """They only take energy out: q̈ = −D q̇ without contact, and at rest gravity compensation alone is left."""
    bench = moving(mode, yield_damping=10.0)
    M = bench.system.GetInputPort("dynamics").Eval(bench.context).M
    assert power(bench, bench.torque) == pytest.approx(-10.0 * bench.v @ M @ bench.v)
    still = Controlled(bench.robot, bench.q)
    still.set(interaction=still.mode(mode), contact_force=[50.0, 0.0, 0.0])
    np.testing.assert_allclose(still.torque, still.terms.gravity, atol=1e-12)


def test_contact_answers_with_the_law_at_the_latched_point(moving, lwr4):
    """x_d is where the point of the body was when the contact began."""
    bench = moving(CONTACT, M_d=[20.0, 3.0, 10.0])
    contact = bench.mode(CONTACT).contact
    terms = evaluate_dynamics(lwr4, bench.q, bench.v)
    point = terms.point(contact.link, contact.p_LC)
    p_desired = point_position(lwr4, lwr4.home, contact.link, contact.p_LC)
    law = ImpedanceGains(500.0 * np.eye(3), 80.0 * np.eye(3), np.linalg.inv(M_D), np.full(7, 20.0), 0.03, MAX_MASS)
    expected = contact_impedance_torque(terms, point, p_desired, np.array([5.0, -8.0, 3.0]), 0.1 * np.ones(7), law)
    for actual, part in zip(bench.terms, expected, strict=True):
        np.testing.assert_allclose(actual, part, atol=1e-12)
    np.testing.assert_array_equal(bench.read("position_error"), p_desired - point.p_WC)
    np.testing.assert_array_equal(bench.read("contact_position"), point.p_WC)


def test_return_is_the_same_law_as_contact(moving):
    np.testing.assert_array_equal(moving(RETURN).torque, moving(CONTACT).torque)


def test_hold_pulls_to_the_latched_posture(moving, lwr4):
    bench = moving(HOLD)
    expected = posture_torque(evaluate_dynamics(lwr4, bench.q, bench.v), lwr4.home, np.full(7, 225.0), np.full(7, 30.0))
    np.testing.assert_allclose(bench.torque, limit_torque(expected.total(), lwr4.tau_max)[0], atol=1e-12)
    np.testing.assert_array_equal(bench.read("position_error"), 0.0)


@pytest.mark.parametrize("after", InteractionMode)
@pytest.mark.parametrize("before", InteractionMode)
def test_change_of_mode_makes_no_jump_and_fades(moving, before, after):
    """The torque goes on from where it was, and tends to that of the new law with the transition time."""
    fade = 0.1
    bench, alone = moving(before, transition_time=fade), moving(after)
    bench.run(3)
    old, new = bench.torque, alone.torque
    bench.set(interaction=bench.mode(after, onset=1))
    np.testing.assert_allclose(bench.torque, old, atol=1e-9)
    for k in range(1, 200):
        bench.run()
        expected = new + (old - new) * np.exp(-k * PERIOD / fade)
        np.testing.assert_allclose(bench.torque, expected, atol=1e-9)
    np.testing.assert_allclose(bench.torque, new, atol=1e-2)


def test_change_of_mode_during_a_transition_makes_no_jump_either(moving):
    """The torque goes on from the one that acted in the cycle before."""
    bench = moving(HOLD)
    bench.run()
    for onset, mode in enumerate((CONTACT, YIELD, CONTACT, STOP, HOLD), start=1):
        bench.run(2)
        before = bench.torque
        bench.run()
        bench.set(interaction=bench.mode(mode, onset))
        np.testing.assert_allclose(bench.torque, before, atol=1e-9)


def test_new_contact_point_on_another_link_makes_no_jump(moving):
    bench = moving(CONTACT)
    bench.run(2)
    before = bench.torque
    bench.set(interaction=bench.mode(CONTACT, onset=1, link=3))
    np.testing.assert_allclose(bench.torque, before, atol=1e-9)


def test_first_cycle_has_nothing_to_fade_from(moving):
    np.testing.assert_array_equal(moving(HOLD).terms.transition, 0.0)


def test_limits_are_applied_last_and_what_they_cut_is_reported(lwr4):
    """commanded + excess = the sum of all terms, also while a transition fades."""
    bench = Controlled(lwr4, lwr4.home + 0.6)
    for onset, mode in enumerate((HOLD, CONTACT, YIELD, HOLD)):
        bench.run(interaction=bench.mode(mode, onset), contact_force=[900.0, 900.0, -900.0])
        total = bench.terms.total()
        assert np.all(np.abs(bench.torque) <= lwr4.tau_max)
        np.testing.assert_allclose(bench.torque + bench.read("torque_excess"), total, atol=1e-9)
        np.testing.assert_array_equal(bench.torque, np.clip(total, -lwr4.tau_max, lwr4.tau_max))
    assert np.any(Controlled(lwr4, lwr4.home + 0.6).read("torque_excess") != 0.0)


def test_clone_of_the_context_goes_on_by_itself(moving):
    bench = moving(HOLD)
    bench.run()
    bench.set(interaction=bench.mode(CONTACT, onset=1))
    twin, before = bench.clone(), bench.torque
    twin.run(5)
    assert np.max(np.abs(twin.read("torque_commanded") - before)) > 0.1
    np.testing.assert_array_equal(bench.torque, before)
    bench.run(5)
    np.testing.assert_array_equal(bench.torque, twin.read("torque_commanded"))


def test_nan_force_stops_the_evaluation(moving):
    """A lost estimate is no command."""
    bench = moving(CONTACT, M_d=[20.0, 3.0, 10.0])
    bench.set(contact_force=np.full(3, np.nan))
    with pytest.raises(StateError, match="torque"):
        bench.read("torque_commanded")


# ---- parameters ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("K_p", -1.0),
        ("K_p", [500.0, 500.0]),
        ("K_d", [80.0, np.nan, 80.0]),
        ("M_d", [20.0, 0.0, 10.0]),
        ("M_d", [20.0, -3.0, 10.0]),
        ("M_d", [20.0, 3.0]),
        ("K_N", -20.0),
        ("misfit_lever", -0.01),
        ("hold_stiffness", -1.0),
        ("hold_damping", np.inf),
        ("yield_damping", [10.0, -1.0]),
        ("transition_time", 0.0),
        ("max_effective_mass", 0.0),
        ("period", 0.0),
    ],
)
def test_bad_parameters(name, value):
    with pytest.raises(ParameterError, match=f"^{name}: "):
        ContactImpedanceParameters(**{name: value})


@pytest.mark.parametrize("name", ["K_N", "hold_stiffness", "hold_damping", "yield_damping"])
def test_joint_gains_of_the_wrong_size(lwr4, name):
    with pytest.raises(ParameterError, match=f"^{name}: needs 1 or 7 entries"):
        ContactImpedanceController(lwr4, replace(ContactImpedanceParameters(), **{name: [1.0, 2.0]}))
