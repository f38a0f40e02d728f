"""Task space and null space: identities, bounds where a Jacobian loses rank, and the plain twin in coordinates."""

from types import SimpleNamespace

import numpy as np
import pytest
from arms import states
from null_space_basis import null_space, reference_basis

from saphari_drake.math.task_space import (
    consistent_inverse,
    project,
    sampled_damping,
    task_coriolis,
    task_space,
    velocity_torque,
)
from saphari_drake.math.tree_matrices import coriolis_matrix, frame_jacobian
from saphari_drake.robots.dynamics import evaluate_dynamics

MAX_MASS = 50.0
STEP = 1e-6
BENT = np.array([0.2, 0.6, 0.3, 1.4, 0.4, 1.0, 0.2])  # away from singularities on both arms
REDUNDANT = ("lwr4", "xarm7")


def state(robot, q, v):
    """Return all matrices of a state; the task is a point of the last link."""
    d = evaluate_dynamics(robot, q, v)
    C = coriolis_matrix(robot.tree, d.motion)
    J, Jdot = frame_jacobian(d.motion, 6, np.array([0.1, 0.02, 0.05]))
    return SimpleNamespace(d=d, M=d.M, C=C, J6=J, Jdot6=Jdot, J=J[3:], Jdot=Jdot[3:])


def random_state(robot, seed):
    rng = np.random.default_rng(seed)
    return BENT + rng.uniform(-0.3, 0.3, robot.n), rng.uniform(-1.0, 1.0, robot.n)


def derivative(robot, q, v, read):
    """Return d/dt of ``read(state)`` along v by central differences."""
    return (read(state(robot, q + STEP * v, v)) - read(state(robot, q - STEP * v, v))) / (2.0 * STEP)


def random_task(seed, m=3, n=7):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    return rng.normal(size=(m, n)), A @ A.T + 0.1 * np.eye(n), rng


@pytest.mark.parametrize("seed", range(20))
def test_identities_at_full_rank(seed):
    """J J^# = I, JP = 0, P² = P, P J^# = 0, M J^# = JᵀΛ, and P is self-adjoint in M: no inertial coupling."""
    J, M, _ = random_task(seed)
    Lambda, J_inv, P = consistent_inverse(J, M, 1e6)
    np.testing.assert_allclose(J @ J_inv, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(J @ P, 0.0, atol=1e-9)
    np.testing.assert_allclose(P @ P, P, atol=1e-9)
    np.testing.assert_allclose(P @ J_inv, 0.0, atol=1e-9)
    np.testing.assert_allclose(M @ J_inv, J.T @ Lambda, atol=1e-9)
    np.testing.assert_allclose(M @ P, (M @ P).T, atol=1e-8)
    np.testing.assert_allclose(J @ np.linalg.solve(M, P.T @ M @ P), 0.0, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_least_kinetic_energy(seed):
    """Of all q̇ with Jq̇ = ẋ, J^#ẋ has the least kinetic energy."""
    J, M, rng = random_task(seed)
    _, J_inv, P = consistent_inverse(J, M, 1e6)
    v = J_inv @ rng.normal(size=3)
    for _ in range(10):
        other = v + P @ rng.normal(size=7)
        np.testing.assert_allclose(J @ other, J @ v, atol=1e-9)
        assert v @ M @ v <= other @ M @ other


@pytest.mark.parametrize("seed", range(5))
def test_rank_deficient_jacobian(seed):
    """A direction that J cannot move makes no torque; in the others the inverse stays exact."""
    J, M, rng = random_task(seed)
    u = rng.normal(size=3)
    u /= np.linalg.norm(u)
    tangent = np.eye(3) - np.outer(u, u)
    J = tangent @ J
    Lambda, J_inv, P = consistent_inverse(J, M, MAX_MASS)
    np.testing.assert_allclose(J @ J_inv, tangent, atol=1e-8)
    np.testing.assert_allclose(J_inv @ u, 0.0, atol=1e-8)
    np.testing.assert_allclose(J @ P, 0.0, atol=1e-8)
    np.testing.assert_allclose(u @ Lambda @ u, MAX_MASS)


def test_bounded_and_continuous_through_a_singularity():
    """Effective mass never exceeds its bound, and small changes of J make small changes of JᵀΛ."""
    J, M, _ = random_task(3)
    before = None
    for scale in np.linspace(-0.2, 0.2, 2001):
        J[2] = scale * np.ones(7)
        Lambda, J_inv, _ = consistent_inverse(J, M, MAX_MASS)
        eigenvalues = np.linalg.eigvalsh(Lambda)
        assert eigenvalues[0] > 0.0
        assert eigenvalues[-1] <= MAX_MASS * (1 + 1e-9)
        if before is not None:
            assert np.max(np.abs(M @ J_inv - before)) < 0.05
        before = M @ J_inv


def test_zero_jacobian_has_the_whole_null_space():
    _, M, _ = random_task(0)
    Lambda, J_inv, P = consistent_inverse(np.zeros((3, 7)), M, MAX_MASS)
    np.testing.assert_allclose(Lambda, MAX_MASS * np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(J_inv, 0.0)
    np.testing.assert_array_equal(P, np.eye(7))


def test_lwr4_link_3_has_no_radial_motion(lwr4):
    """Joints 1 to 3 meet in the shoulder: every point of link 3 moves on a sphere round it."""
    shoulder = np.array([0.0, 0.0, 0.3105])
    for q, v in states(lwr4, 20):
        terms = evaluate_dynamics(lwr4, q, v)
        point = terms.point(2, np.array([0.03, 0.05, 0.1]))
        radial = (point.p_WC - shoulder) / np.linalg.norm(point.p_WC - shoulder)
        np.testing.assert_allclose(radial @ point.Jv_WC, 0.0, atol=1e-12)
        Lambda, J_inv, _ = consistent_inverse(point.Jv_WC, terms.M, MAX_MASS)
        assert np.linalg.eigvalsh(Lambda)[-1] <= MAX_MASS * (1 + 1e-9)
        np.testing.assert_allclose(J_inv @ radial, 0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("rows", [slice(3, 6), slice(0, 6)], ids=["position", "pose"])
@pytest.mark.parametrize("name", REDUNDANT)
def test_decoupled_and_skew_symmetric(load_arm, name, rows, seed):
    """J Z = 0, Z^# J_M^# = 0, Z^# Z = I; Λ̇ − 2μ is skew in both spaces; the torque needs no basis."""
    robot = load_arm(name)
    reference = state(robot, BENT, np.zeros(robot.n))
    Z_ref = reference_basis(reference.J6[rows] if rows.start == 0 else reference.J)

    def spaces(x, v):
        J, Jdot = x.J6[rows], x.Jdot6[rows]
        return task_space(J, Jdot, x.M, x.C, v, np.full(len(J), 1e9)), null_space(J, Jdot, x.M, x.C, Z_ref)

    q, v = random_state(robot, seed)
    s = state(robot, q, v)
    task, null = spaces(s, v)
    m, r = len(task.J), null.Z.shape[1]
    np.testing.assert_allclose(task.J @ null.Z, np.zeros((m, r)), atol=1e-12)
    np.testing.assert_allclose(null.Z_inv @ task.J_inv, np.zeros((r, m)), atol=1e-7)
    np.testing.assert_allclose(null.Z_inv @ null.Z, np.eye(r), atol=1e-10)
    np.testing.assert_allclose(task.J_inv @ task.J + null.Z @ null.Z_inv, np.eye(robot.n), atol=1e-6)
    np.testing.assert_allclose(null.Zdot, derivative(robot, q, v, lambda x: spaces(x, v)[1].Z), atol=1e-5)
    mu = np.column_stack([task_coriolis(task, w) for w in np.eye(m)])
    for inertia, coriolis in (
        (derivative(robot, q, v, lambda x: spaces(x, v)[0].Lambda), mu),
        (derivative(robot, q, v, lambda x: spaces(x, v)[1].Lambda), null.mu),
    ):
        N = inertia - 2.0 * coriolis
        np.testing.assert_allclose(N, -N.T, atol=1e-4 * (1.0 + np.abs(N).max()))
    # M Z(−Λ_ν⁻¹μ_ν ν − Ż^# q̇) of (39) in (7), with the derivative of Z^# by finite differences.
    Z_inv_dot = derivative(robot, q, v, lambda x: spaces(x, v)[1].Z_inv)
    nu = null.Z_inv @ v
    torque = s.M @ null.Z @ (-np.linalg.solve(null.Lambda, null.mu @ nu) - Z_inv_dot @ v)
    np.testing.assert_allclose(project(task, velocity_torque(task)), torque, atol=1e-4 * (1 + np.abs(torque).max()))


def test_projector_is_continuous_through_a_near_singular_posture(lwr4):
    """Along a path through the stretched arm it does not jump, as every basis of an SVD does."""
    home = np.deg2rad([0.0, 30.0, 0.0, 60.0, 0.0, 30.0, 0.0])
    projected, raw = [], []
    for a in np.linspace(1.0, -1.0, 2001):
        s = state(lwr4, a * home + [0.0, 0.0, 0.0, 1e-3, 0.0, 1e-3, 0.0], np.zeros(7))
        raw.append(reference_basis(s.J))
        projected.append(project(task_space(s.J, s.Jdot, s.M, s.C, np.zeros(7), np.full(3, 50.0)), np.ones(7)))
    assert np.abs(np.diff(projected, axis=0)).max() < 0.2
    assert np.abs(np.diff(raw, axis=0)).max() > 0.5


def test_sampled_damping_never_exceeds_what_a_cycle_can_do():
    """It is D for heavy parts, M/T for light ones, symmetric and positive definite."""
    D, M = np.array([1.0, 2.0]), np.array([[10.0, 1e-3], [1e-3, 1e-4]])
    B = np.column_stack([sampled_damping(D, M, 0.002, v) for v in np.eye(2)])
    np.testing.assert_allclose(B, np.linalg.inv(np.diag(1.0 / D) + 0.002 * np.linalg.inv(M)), rtol=1e-9)
    np.testing.assert_allclose(B, B.T, atol=1e-12)
    assert np.linalg.eigvalsh(B)[0] > 0.0
    assert B[0, 0] == pytest.approx(1.0, rel=1e-3)
    assert np.linalg.eigvals(np.linalg.solve(M, B)).real.max() < 1.0 / 0.002
