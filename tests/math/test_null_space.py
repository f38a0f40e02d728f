"""Null-space machinery: bases, inertias and Coriolis matrices, checked against identities and finite differences."""

from types import SimpleNamespace

import numpy as np
import pytest

from saphari_drake.math.null_space import null_space, orthonormal, reference_basis, transported_basis
from saphari_drake.math.task_space import project, sampled_damping, task_coriolis, task_space, velocity_torque
from saphari_drake.math.tree_matrices import coriolis_matrix, frame_jacobian
from saphari_drake.robots.dynamics import evaluate_dynamics

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


@pytest.mark.parametrize("name", REDUNDANT)
def test_coriolis_matrix_is_that_of_christoffel(load_arm, name):
    """C q̇ and Cᵀq̇ are those of the dynamics, Ṁ = C + Cᵀ, and C w comes from the bias by polarization."""
    robot = load_arm(name)
    for seed in range(5):
        q, v = random_state(robot, seed)
        s, w = state(robot, q, v), np.random.default_rng(seed + 50).uniform(-1.0, 1.0, robot.n)
        np.testing.assert_allclose(s.C @ v, s.d.Cv, atol=1e-11)
        np.testing.assert_allclose(s.C.T @ v, s.d.CTv, atol=1e-11)
        np.testing.assert_allclose(s.C + s.C.T, derivative(robot, q, v, lambda x: x.M), atol=1e-7)
        polar = 0.5 * (state(robot, q, v + w).d.Cv - s.d.Cv - state(robot, q, w).d.Cv)
        np.testing.assert_allclose(s.C @ w, polar, atol=1e-11)


@pytest.mark.parametrize("name", REDUNDANT)
def test_jacobian_and_its_derivative(load_arm, name):
    """Linear rows are those of the point kinematics; J̇ agrees with finite differences."""
    robot = load_arm(name)
    q, v = random_state(robot, 1)
    s = state(robot, q, v)
    point = s.d.point(6, np.array([0.1, 0.02, 0.05]))
    np.testing.assert_allclose(s.J, point.Jv_WC, atol=1e-12)
    np.testing.assert_allclose(s.Jdot @ v, point.Jdotv_WC, atol=1e-11)
    np.testing.assert_allclose(s.Jdot6, derivative(robot, q, v, lambda x: x.J6), atol=1e-7)


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


def test_basis_continuous_through_a_near_singular_posture(lwr4):
    """Along a path through the stretched arm neither the basis nor the torque projector jumps; bases of an SVD do."""
    home = np.deg2rad([0.0, 30.0, 0.0, 60.0, 0.0, 30.0, 0.0])
    Z_ref = reference_basis(state(lwr4, home, np.zeros(7)).J)
    bases, projectors, raw, gaps = [], [], [], []
    for a in np.linspace(1.0, -1.0, 2001):
        s = state(lwr4, a * home + [0.0, 0.0, 0.0, 1e-3, 0.0, 1e-3, 0.0], np.zeros(7))
        Z = transported_basis(s.J, Z_ref)
        gaps.append(np.abs(s.J @ Z).max())
        Z_ref = orthonormal(Z)
        bases.append(Z_ref)
        raw.append(reference_basis(s.J))
        projectors.append(project(task_space(s.J, s.Jdot, s.M, s.C, np.zeros(7), np.full(3, 50.0)), np.ones(7)))
    step = lambda values: np.abs(np.diff(np.array(values), axis=0)).max()  # noqa: E731
    assert step(bases) < 0.05
    assert step(projectors) < 0.2
    assert step(raw) > 0.5
    assert max(gaps) < 0.02
    assert np.median(gaps) < 1e-12


def test_sampled_damping_never_exceeds_what_a_cycle_can_do():
    """It is D for heavy parts, M/T for light ones, symmetric and positive definite."""
    D, M = np.array([1.0, 2.0]), np.array([[10.0, 1e-3], [1e-3, 1e-4]])
    B = np.column_stack([sampled_damping(D, M, 0.002, v) for v in np.eye(2)])
    np.testing.assert_allclose(B, np.linalg.inv(np.diag(1.0 / D) + 0.002 * np.linalg.inv(M)), rtol=1e-9)
    np.testing.assert_allclose(B, B.T, atol=1e-12)
    assert np.linalg.eigvalsh(B)[0] > 0.0
    assert B[0, 0] == pytest.approx(1.0, rel=1e-3)
    assert np.linalg.eigvals(np.linalg.solve(M, B)).real.max() < 1.0 / 0.002
