"""Laws of the null-space compliance in a closed loop: against plain numpy, steady states, postures, arms, pose task."""

from copy import copy

import numpy as np
import pytest
from null_space_basis import null_space, reference_basis
from null_space_loop import Loop, bent
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.control.null_space.law import Desired, Yielding, advance_offset, saturated, shifted
from saphari_drake.control.null_space.parameters import OBSERVERS, NullSpaceComplianceParameters
from saphari_drake.control.null_space.system import NullSpaceComplianceController
from saphari_drake.math.rotations import axis_rotation, rotation_log, rotation_rate
from saphari_drake.math.task_space import project
from saphari_drake.math.tree_matrices import coriolis_matrix
from saphari_drake.robots.dynamics import evaluate_dynamics

HOME = np.deg2rad([0.0, -30.0, 0.0, 90.0, 0.0, 60.0, 0.0])


def plain_torque(controller, robot, d, X_d, V_d, A_d, estimate, q_d):
    """Return the torque of Section 5 as its equations stand, with numpy, a basis of the null space and its derivative.

    Also the task error.
    """
    g, p, m = controller.gains, controller.params, controller.m
    now = controller.kinematics(d)
    C = coriolis_matrix(robot.tree, d.motion)
    J, Jdot = now.task.J, now.task.Jdot
    M_inv = np.linalg.inv(d.M)
    Lambda = np.linalg.inv(J @ M_inv @ J.T)
    J_inv = M_inv @ J.T @ Lambda
    mu = J_inv.T @ C @ J_inv - Lambda @ Jdot @ J_inv
    e, v = X_d[1] - now.p, (V_d - now.V)[-m:]
    rate = v
    if m == 6:
        turn = rotation_log(X_d[0] @ now.R.T)
        e, rate = np.concatenate([turn, e]), np.concatenate([rotation_rate(turn, V_d[:3], now.V[:3]), v[3:]])

    def sampled(D, inertia):
        return np.linalg.inv(np.diag(1.0 / D) + p.period * np.linalg.inv(inertia))

    felt = J_inv.T @ estimate
    if p.observer == "task_error":
        s = v + g.P * e
        push = (mu + sampled(g.K, Lambda)) @ s + felt
        a = A_d[-m:] + g.P * rate + np.linalg.solve(Lambda, push)
    elif p.observer == "momentum":
        a = A_d[-m:] + g.K_v * v + g.K_p * e + np.linalg.solve(Lambda, felt)
    else:
        push = (mu + sampled(g.D, Lambda)) @ v + g.K_x * e + (felt if p.observer == "task_error_pd" else 0.0)
        a = A_d[-m:] + np.linalg.solve(Lambda, push)
    null = null_space(J, Jdot, d.M, C, reference_basis(J))
    nu, Mdot = null.Z_inv @ d.v, C + C.T
    change = null.Zdot.T @ d.M @ null.Z + null.Z.T @ Mdot @ null.Z + null.Z.T @ d.M @ null.Zdot
    lead = null.Zdot.T @ d.M + null.Z.T @ Mdot
    Z_inv_dot = np.linalg.solve(null.Lambda, lead - change @ null.Z_inv)
    B = null.Z.T @ sampled(np.full(robot.n, p.null_damping), d.M) @ null.Z
    pull = null.Z.T @ (p.null_stiffness * (q_d - d.q)) - (null.mu + B) @ nu
    nu_dot = np.linalg.solve(null.Lambda, pull)
    qddot = J_inv @ (a - Jdot @ d.v) + null.Z @ (nu_dot - Z_inv_dot @ d.v)
    return d.M @ qddot + d.Cv + d.g + robot.viscous * d.v, e


@pytest.mark.parametrize("task", ["position", "pose"])
@pytest.mark.parametrize("observer", OBSERVERS)
@pytest.mark.parametrize("name", ["lwr4", "xarm7"])
def test_compiled_law_is_that_of_the_equations(load_arm, name, observer, task):
    """Torque and error equal (36) to (46) written out in numpy, in motion, on a moving target, for any basis."""
    robot = copy(load_arm(name))
    robot.home = bent(0)
    params = NullSpaceComplianceParameters(
        observer=observer, task=task, gamma=1e-3, null_stiffness=7.0, null_damping=3.0, torque_threshold=np.inf,
    )  # fmt: skip
    controller = NullSpaceComplianceController(robot, params)
    context = controller.CreateDefaultContext()
    for seed in range(3):
        rng = np.random.default_rng(seed)
        d = evaluate_dynamics(robot, bent(seed), rng.uniform(-0.5, 0.5, robot.n))
        now = controller.kinematics(d)
        X_d = axis_rotation(np.array([0.0, 0.6, 0.8]), 0.02) @ now.R, now.p + 0.01 * rng.normal(size=3)
        V_d, A_d, estimate = rng.normal(size=6), rng.normal(size=6), rng.normal(size=robot.n)
        q_d = d.q + rng.uniform(-0.1, 0.1, robot.n)
        values = {
            "dynamics": AbstractValue.Make(d), "torque_external_task": -estimate, "torque_external": -estimate,
            "desired_pose": AbstractValue.Make(RigidTransform(RotationMatrix(X_d[0]), X_d[1])),
            "desired_velocity": V_d, "desired_acceleration": A_d, "nominal_posture": q_d,
        }  # fmt: skip
        for port, value in values.items():
            controller.GetInputPort(port).FixValue(context, value)
        torque, error = plain_torque(controller, robot, d, X_d, V_d, A_d, estimate, q_d)
        terms = controller.GetOutputPort("torque_terms").Eval(context).reshape(5, robot.n)
        np.testing.assert_allclose(controller.GetOutputPort("task_error").Eval(context), error, atol=1e-9)
        np.testing.assert_allclose(terms.sum(axis=0), torque, atol=1e-4 * (1.0 + np.abs(torque).max()))


def test_target_follows_then_returns_with_bounded_speed():
    """It is where the frame was pushed when the task ceases to yield, and goes straight back, gradually."""
    away, offset, speed, period = np.array([0.3, 0.0, -0.4]), np.zeros(3), 0.0, 0.002
    for _ in range(250):
        offset, speed = advance_offset(offset, speed, away, 1.0, 0.25, period)
    np.testing.assert_allclose(offset, away, rtol=1e-3)
    path, speeds = [offset], [speed]
    for _ in range(2500):
        offset, speed = advance_offset(offset, speed, away, 0.0, 0.25, period)
        path.append(offset)
        speeds.append(speed)
    assert np.array_equal(path[-1], np.zeros(3))
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert steps.max() <= 0.25 * period * (1.0 + 1e-9) and max(speeds) == 0.25
    assert np.abs(np.diff(speeds)).max() < 2.0 * period
    np.testing.assert_allclose(np.cross(path, away), 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_velocity_of_a_target_that_returns_is_that_of_its_pose(seed):
    """Position and orientation, by central differences along the shrinking offset; none where there is no offset."""
    rng, h = np.random.default_rng(seed), 1e-6
    offset, speed = rng.normal(size=6), np.array([0.7, 0.2])
    R_d = axis_rotation(np.array([0.6, 0.0, 0.8]), 0.5)
    desired = Desired(R_d, rng.normal(size=3), np.zeros(6), np.zeros(6), np.zeros(7))

    def target(t):
        left = [part * (1.0 - s * t / np.linalg.norm(part)) for part, s in zip((offset[:3], offset[3:]), speed)]
        return shifted(desired, Yielding(0.0, np.concatenate(left), speed))

    ahead, here, behind = (target(t) for t in (h, 0.0, -h))
    np.testing.assert_allclose(here.V[3:], (ahead.p - behind.p) / (2 * h), atol=1e-8)
    np.testing.assert_allclose(here.V[:3], rotation_log(ahead.R @ behind.R.T) / (2 * h), atol=1e-8)
    rest = shifted(desired, Yielding(0.0, np.zeros(6), np.zeros(2)))
    np.testing.assert_array_equal(rest.V, np.zeros(6))
    np.testing.assert_array_equal(rest.R, R_d)


def pushed(robot, seed):
    """Return the task errors without and with an observer in a random posture under a random push."""
    observer, duration = (("momentum", 1.6), ("task_error", 1.6), ("task_error_pd", 10.0))[seed % 3]
    none, kept, F, where = Loop.pushed(robot, observer, bent(seed), seed)
    errors = none.run(1.6, F, **where), kept.run(duration, F, **where)
    assert np.linalg.norm(none.v) < 1.0 and np.linalg.norm(kept.v) < 1.0
    return errors


@pytest.mark.parametrize(("name", "seed"), [*(("lwr4", k) for k in range(20)), *(("xarm7", k) for k in range(5))])
def test_random_postures_and_pushes(load_arm, name, seed):
    """Stable, and with an observer the steady task error is less than a hundredth of the one without."""
    without, error = pushed(load_arm(name), seed)
    assert np.all(np.isfinite(without)) and np.all(np.isfinite(error))
    assert without[-1] > 100.0 * error[-1]


def test_steady_error_without_observer(lwr4):
    """x̃ = K⁻¹ J_M^{#T} τ_ext, and Zᵀ(K_p q̃ − τ_ext) → 0."""
    loop = Loop(lwr4, "none", HOME)
    loop.run(8.0, np.array([2.0, -12.0, 1.0]))
    expected = loop.task.J_inv.T @ loop.tau_ext / loop.controller.gains.K_x
    np.testing.assert_allclose(loop.e.error, expected, rtol=1e-2, atol=1e-7)
    balance = project(loop.task, 10.0 * (loop.rest - loop.q) - loop.tau_ext)
    assert np.linalg.norm(balance) < 0.02 * np.linalg.norm(loop.tau_ext)


@pytest.mark.parametrize("observer", ["none", "task_error", "task_error_pd", "momentum"])
def test_pose_task(lwr4, observer):
    """All laws turn and move the frame to a pose 0.4 rad and 3 cm away and keep it there under a push."""
    loop = Loop(lwr4, observer, HOME, task="pose", gamma=0.08)
    loop.R_d = axis_rotation(np.array([0.6, 0.0, 0.8]), 0.4) @ loop.R_d
    loop.p_d = loop.p_d + np.array([0.0, 0.03, -0.02])
    # Proposition 2 holds on to what it has learned for about 1/gamma.
    errors = loop.run(20.0 if observer == "task_error_pd" else 3.0, np.array([0.0, -3.0, 0.0]))
    assert np.all(np.isfinite(errors))
    limit = {"none": 0.03, "task_error_pd": 0.15}.get(observer, 2e-3)
    assert np.linalg.norm(loop.e.error) < limit


@pytest.mark.parametrize("observer, limit", [("task_error", 2e-4), ("task_error_pd", 2e-3), ("momentum", 2e-3)])
def test_pose_task_on_a_moving_target(lwr4, observer, limit):
    """Position on a circle and a turning orientation are followed while the body is pushed."""
    loop = Loop(lwr4, observer, HOME, task="pose", gamma=0.08)
    R, p, w, rate = loop.R_d, loop.p_d.copy(), 1.5, 0.3
    errors = []
    for k in range(2000):
        t = 0.002 * k
        angle = rate * (t - np.sin(w * t) / w)  # starts at rest
        turn = rate * (1.0 - np.cos(w * t))
        loop.R_d = axis_rotation(np.array([0.0, 0.0, 1.0]), angle) @ R
        swing = 0.05 * (1.0 - np.cos(w * t))
        loop.p_d = p + np.array([0.0, swing, -swing])
        loop.V_d = np.array([0.0, 0.0, turn, 0.0, *(0.05 * w * np.sin(w * t) * np.array([1.0, -1.0]))])
        loop.A_d = np.array(
            [0.0, 0.0, rate * w * np.sin(w * t), 0.0, *(0.05 * w**2 * np.cos(w * t) * np.array([1.0, -1.0]))]
        )
        loop.step(np.array([0.0, -6.0 * min(t, 1.0), 0.0]))
        errors.append(np.abs(loop.e.error).max())
    assert max(errors) < limit


@pytest.mark.parametrize("m", [3, 6])
def test_the_observer_s_error_is_bounded_whatever_the_error_is(m):
    """f(x̃) of (44): along x̃, as x̃ where that is small, and growing with it to a norm of 1 m, which it never reaches."""
    scale = np.r_[np.full(m - 3, 0.1), np.ones(3)]
    direction = np.random.default_rng(m).normal(size=m)
    direction /= np.linalg.norm(scale * direction)
    sizes = np.array([1e-9, 1e-3, 0.1, 0.9, 1.0, 1.1, 10.0, 1e6])
    values = np.array([saturated(size * direction, scale) for size in sizes])
    norms = np.linalg.norm(scale * values, axis=1)
    np.testing.assert_allclose(values, np.outer(norms, direction), rtol=1e-9)
    assert np.all(np.diff(norms) > 0.0) and np.all(norms < 1.0) and norms[-1] > 0.999
    np.testing.assert_allclose(norms[0], sizes[0], rtol=1e-6)
