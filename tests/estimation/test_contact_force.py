"""The contact force from the residual: exact where it is observable, honest and bounded where it is not."""

import numpy as np
import pytest
from arms import states
from bench import Bench

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.contact_force import (
    ContactForceEstimator,
    ContactForceParameters,
    estimate_contact_force,
)
from saphari_drake.messages import ContactPoint, SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics

RCOND = ContactForceParameters().rcond
SHOULDER = np.array([0.0, 0.0, 0.3105])


def contacts(robot, links, count=50, seed=0):
    """Random states and points on links: yields link, p_LC, point kinematics and a random force."""
    rng = np.random.default_rng(seed)
    for q, v in states(robot, count, seed):
        link = int(rng.choice(links))
        p_LC = np.append(rng.uniform(-0.07, 0.07, 2), rng.uniform(0.0, 0.2))
        yield link, p_LC, evaluate_dynamics(robot, q, v).point(link, p_LC), rng.uniform(-40.0, 40.0, 3)


def test_recovers_any_force_on_links_4_to_7(lwr4):
    """F̂ = F for r = JᵀF, with rank 3, nothing unobservable and no misfit."""
    recovered = 0
    for _, _, point, F in contacts(lwr4, [3, 4, 5, 6], 200):
        J = point.Jv_WC
        singular = np.linalg.svd(J, compute_uv=False)
        estimate = estimate_contact_force(J, J.T @ F, RCOND)
        if singular[-1] > RCOND * singular[0]:
            recovered += 1
            assert estimate.rank == 3
            np.testing.assert_allclose(estimate.F_W, F, atol=1e-9)
            np.testing.assert_array_equal(estimate.unobservable, 0.0)
            np.testing.assert_allclose(estimate.misfit, 0.0, atol=1e-9)
    assert recovered > 180


def test_link_3_does_not_show_the_radial_force(lwr4):
    """Rank 2; the unobservable direction points to the shoulder; the rest of the force is recovered."""
    for _, _, point, F in contacts(lwr4, [2]):
        estimate = estimate_contact_force(point.Jv_WC, point.Jv_WC.T @ F, RCOND)
        radial = (point.p_WC - SHOULDER) / np.linalg.norm(point.p_WC - SHOULDER)
        if estimate.rank == 2:
            assert abs(radial @ estimate.unobservable[:, 0]) == pytest.approx(1.0)
            np.testing.assert_allclose(estimate.F_W, F - radial * (radial @ F), atol=1e-9)
        else:  # a singular posture hides more
            assert estimate.rank == 1


@pytest.mark.parametrize(("link", "rank"), [(0, 1), (1, 2), (2, 2)])
def test_rank_on_the_first_links(lwr4, link, rank):
    """Link 1 only turns about its axis; links 2 and 3 move on a sphere."""
    ranks = {estimate_contact_force(p.Jv_WC, p.Jv_WC.T @ F, RCOND).rank for *_, p, F in contacts(lwr4, [link])}
    assert max(ranks) == rank


@pytest.mark.parametrize("link", range(7))
def test_estimate_is_the_projection_on_what_can_be_observed(lwr4, link):
    """F = F̂ + its unobservable part, so that F̂ is never larger than F, at any rank."""
    for _, _, point, F in contacts(lwr4, [link]):
        estimate = estimate_contact_force(point.Jv_WC, point.Jv_WC.T @ F, RCOND)
        hidden = estimate.unobservable
        np.testing.assert_allclose(estimate.F_W + hidden @ (hidden.T @ F), F, atol=1e-9)
        assert np.linalg.norm(estimate.F_W) <= np.linalg.norm(F) * (1 + 1e-12)
        np.testing.assert_allclose(hidden.T @ hidden, np.diag(np.arange(3) < 3 - estimate.rank), atol=1e-12)


@pytest.mark.parametrize("link", range(7))
def test_never_larger_than_the_truncation_allows(lwr4, link):
    """|F̂| ≤ |r|/(rcond s_max) for any residual, noise and wrong points included."""
    rng = np.random.default_rng(link)
    for _, _, point, _ in contacts(lwr4, [link]):
        r = rng.normal(size=7)
        largest = np.linalg.norm(point.Jv_WC, 2)
        F_W = estimate_contact_force(point.Jv_WC, r, RCOND).F_W
        assert np.linalg.norm(F_W) <= np.linalg.norm(r) / (RCOND * largest) * (1 + 1e-9)


@pytest.mark.parametrize(("smallest", "rank"), [(1.01 * RCOND, 3), (0.99 * RCOND, 2), (0.0, 2)])
def test_nearly_unobservable_direction_is_left_out(smallest, rank):
    """Just below the truncation, a torque of 1 Nm would make a force of 50 N; it makes none, and is reported."""
    rng = np.random.default_rng(0)
    U, V = (np.linalg.qr(rng.normal(size=(n, n)))[0] for n in (3, 7))
    J = U @ np.diag([1.0, 0.5, smallest]) @ V[:, :3].T
    estimate = estimate_contact_force(J, V[:, 2], RCOND)
    assert estimate.rank == rank
    if rank == 3:
        np.testing.assert_allclose(estimate.F_W, U[:, 2] / smallest)
    else:
        np.testing.assert_allclose(estimate.F_W, 0.0, atol=1e-12)
        assert abs(estimate.unobservable[:, 0] @ U[:, 2]) == pytest.approx(1.0)
        np.testing.assert_allclose(estimate.misfit, V[:, 2], atol=1e-12)


def test_misfit_is_what_no_force_at_the_point_explains(lwr4):
    """misfit = r − JᵀF̂ is the least residual of all forces."""
    rng = np.random.default_rng(5)
    for _, _, point, _ in contacts(lwr4, [3, 4, 5, 6], 20):
        J, r = point.Jv_WC, rng.normal(size=7)
        estimate = estimate_contact_force(J, r, RCOND)
        np.testing.assert_allclose(estimate.misfit, r - J.T @ estimate.F_W, atol=1e-12)
        for _ in range(10):
            other = estimate.F_W + estimate.rank / 3 * rng.normal(size=3)
            assert np.linalg.norm(estimate.misfit) <= np.linalg.norm(r - J.T @ other) + 1e-12


def test_point_that_cannot_move_has_rank_0():
    estimate = estimate_contact_force(np.zeros((3, 7)), np.ones(7), RCOND)
    assert estimate.rank == 0
    np.testing.assert_array_equal(estimate.F_W, 0.0)
    np.testing.assert_allclose(estimate.unobservable @ estimate.unobservable.T, np.eye(3))
    np.testing.assert_array_equal(estimate.misfit, 1.0)


# ---- the system ----------------------------------------------------------------------------------------------------


@pytest.fixture
def bench(lwr4):
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    return Bench(
        ContactForceEstimator(lwr4), dynamics=terms, torque_external=np.arange(1.0, 8.0), contact_point=ContactPoint()
    ), terms


def test_ports_without_a_contact_point(bench):
    """No force, nothing determined, all of the residual unexplained."""
    system, _ = bench
    np.testing.assert_array_equal(system.read("contact_force"), 0.0)
    assert system.read("rank") == 0.0
    np.testing.assert_array_equal(system.read("unobservable_directions"), np.eye(3).ravel())
    np.testing.assert_array_equal(system.read("misfit"), np.arange(1.0, 8.0))


def test_ports_with_a_contact_point(bench):
    """They publish the estimate, matrices by columns."""
    system, terms = bench
    F = np.array([5.0, -10.0, 20.0])
    for link in (2, 5):
        p_LC = np.array([0.02, 0.05, 0.1])
        J = terms.point(link, p_LC).Jv_WC
        system.set(contact_point=ContactPoint(found=True, link=link, p_LC=p_LC), torque_external=J.T @ F)
        expected = estimate_contact_force(J, J.T @ F, RCOND)
        np.testing.assert_array_equal(system.read("contact_force"), expected.F_W)
        assert system.read("rank") == expected.rank == (2 if link == 2 else 3)
        columns = system.read("unobservable_directions").reshape(3, 3)
        np.testing.assert_array_equal(columns, expected.unobservable.T)
        np.testing.assert_array_equal(system.read("misfit"), expected.misfit)


@pytest.mark.parametrize("bad", [0.0, 1.0, -0.1, np.nan])
def test_bad_truncation(bad):
    with pytest.raises(ParameterError, match="rcond"):
        ContactForceParameters(rcond=bad)


def test_a_force_with_hardly_a_lever_arm_is_not_estimated():
    """On link 1 near its axis, a residual of 1 Nm is no force of thousands of newtons, whatever the ratio is."""
    J = np.zeros((3, 7))
    J[1, 0] = 0.005
    r = np.eye(7)[0]
    assert estimate_contact_force(J, r, RCOND).rank == 1
    estimate = estimate_contact_force(J, r, RCOND, ContactForceParameters().least_lever)
    assert estimate.rank == 0
    np.testing.assert_array_equal(estimate.F_W, 0.0)
    np.testing.assert_array_equal(estimate.misfit, r)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("port", ["dynamics", "torque_external", "contact_point"])
def test_an_input_that_is_not_finite_makes_no_force_but_a_status(bench, port, bad):
    """Not known is NaN, with no direction determined; known again, all is as before."""
    system, terms = bench
    good = {"dynamics": terms, "torque_external": np.ones(7), "contact_point": ContactPoint(True, 5, np.zeros(3))}
    worse = {"dynamics": terms.unknown(), "torque_external": np.r_[bad, np.zeros(6)],
             "contact_point": ContactPoint(True, 5, np.array([0.0, bad, 0.0]))}  # fmt: skip
    system.set(**good)
    force = system.read("contact_force")
    system.set(**{port: worse[port]})
    assert system.read("system_status") == SystemStatus.BAD_INPUT and system.read("rank") == 0.0
    assert np.isnan(system.read("contact_force")).all() and np.isnan(system.read("misfit")).all()
    system.set(**good)
    assert system.read("system_status") == SystemStatus.OK
    np.testing.assert_array_equal(system.read("contact_force"), force)


def test_a_link_that_is_none_makes_no_force(bench):
    system, _ = bench
    system.set(contact_point=ContactPoint(True, 7, np.zeros(3)))
    assert system.read("system_status") == SystemStatus.BAD_INPUT
