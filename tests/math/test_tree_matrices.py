"""Jacobians, their derivatives and the Coriolis matrix: finite differences, Christoffel symbols, and Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from arms import ARMS, FIXED, PinocchioTwin, states, write_random_tree

from saphari_drake.math.tree_matrices import coriolis_matrix, frame_jacobian, jacobian, world_point
from saphari_drake.robots.catalog import omnirob
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel

STEP = 1e-6
POINT = np.array([0.1, 0.02, 0.05])


@pytest.fixture(params=[*ARMS, "omnirob", 0, 1, 2])
def robot(request, load_arm, tmp_path):
    """Arms of files, a platform with an arm, and random trees with branches, by their seeds."""
    if isinstance(request.param, int):
        return RobotModel(write_random_tree(tmp_path, request.param))
    return omnirob() if request.param == "omnirob" else load_arm(request.param)


def derivative(robot, q, v, read):
    """Return d/dt of ``read(terms)`` along v by central differences."""
    ahead, behind = (read(evaluate_dynamics(robot, q + s * STEP * v, v)) for s in (1.0, -1.0))
    return (ahead - behind) / (2.0 * STEP)


def test_coriolis_matrix_is_that_of_christoffel(robot):
    """C q̇ and Cᵀq̇ are those of the dynamics, Ṁ = C + Cᵀ, and C w comes from the bias by polarization."""
    for q, v in states(robot, 5):
        d, w = evaluate_dynamics(robot, q, v), np.random.default_rng(5).uniform(-1.0, 1.0, robot.n)
        C, size = coriolis_matrix(robot.tree, d.motion), 1.0 + np.abs(d.M).max()
        np.testing.assert_allclose(C @ v, d.Cv, atol=1e-11 * size)
        np.testing.assert_allclose(C.T @ v, d.CTv, atol=1e-11 * size)
        np.testing.assert_allclose(C + C.T, derivative(robot, q, v, lambda x: x.M), atol=1e-7 * size)
        polar = 0.5 * (evaluate_dynamics(robot, q, v + w).Cv - d.Cv - evaluate_dynamics(robot, q, w).Cv)
        np.testing.assert_allclose(C @ w, polar, atol=1e-11 * size)


def test_jacobians_are_derivatives(robot):
    """Of every link: columns by differences of the pose, J̇ by differences of J; linear rows are those of the point."""
    for q, v in states(robot, 3, seed=1):
        d = evaluate_dynamics(robot, q, v)
        for link in range(robot.n):
            J, Jdot = frame_jacobian(d.motion, link, POINT)
            point = d.point(link, POINT)
            np.testing.assert_array_equal(J, jacobian(d.motion, link, point.p_WC))
            np.testing.assert_array_equal(J[3:], point.Jv_WC)
            np.testing.assert_allclose(Jdot[3:] @ v, point.Jdotv_WC, atol=1e-11)
            found = derivative(robot, q, v, lambda x, k=link: frame_jacobian(x.motion, k, POINT)[0])
            np.testing.assert_allclose(Jdot, found, atol=1e-7)
            turn = derivative(robot, q, v, lambda x, k=link: x.R_WL[k]) @ d.R_WL[link].T
            np.testing.assert_allclose(J[:3] @ v, [turn[2, 1], turn[0, 2], turn[1, 0]], atol=1e-8)
            found = derivative(robot, q, v, lambda x, k=link: world_point(x.motion, k, POINT))
            np.testing.assert_allclose(J[3:] @ v, found, atol=1e-8)


@pytest.mark.parametrize("name", [name for name in ARMS if name not in FIXED])
def test_jacobian_and_coriolis_matrix_equal_pinocchios(load_arm, name):
    """Orientation rows too; Pinocchio's C is not that of Christoffel, but C + Cᵀ is the same."""
    robot = load_arm(name)
    twin = PinocchioTwin(robot)
    o, R_WB = twin.order, robot.X_WB.rotation().matrix()
    for q, v in states(robot, 10, seed=2):
        d, own_q, own_v = evaluate_dynamics(robot, q, v), np.empty(robot.n), np.empty(robot.n)
        own_q[o], own_v[o] = q, v
        pin.computeJointJacobians(twin.model, twin.data, own_q)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J = pin.getJointJacobian(twin.model, twin.data, twin.joints[-1], aligned)[:, o]
        found = jacobian(d.motion, robot.n - 1, d.p_WL[-1])
        np.testing.assert_allclose(found, np.vstack([R_WB @ J[3:], R_WB @ J[:3]]), atol=1e-10)
        C, theirs = coriolis_matrix(robot.tree, d.motion), twin.coriolis(q, v)
        np.testing.assert_allclose(C + C.T, theirs + theirs.T, atol=1e-9)
