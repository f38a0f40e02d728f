"""Null-space compliance: steady states, ratios over postures and arms, pose task, threshold, ports and bad input."""

import numpy as np
import pytest
from null_space_loop import Loop
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.control.null_space_compliance import NullSpaceComplianceController
from saphari_drake.control.null_space_laws import rotation_log, rotation_rate
from saphari_drake.control.null_space_parameters import NullSpaceComplianceParameters
from saphari_drake.errors import ParameterError, StateError, UnknownNameError
from saphari_drake.math.rotations import axis_rotation
from saphari_drake.math.task_space import project
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.null_space_cell import NullSpaceCellParameters, add_null_space_cell
from saphari_drake.simulation.obstacle_bodies import BallParameters, ball_travel
from saphari_drake.simulation.obstacle_cell import ObstacleCellParameters, add_obstacle_cell
from saphari_drake.simulation.task_motion import StraightMotionParameters, straight_motion

HOME = np.deg2rad([0.0, -30.0, 0.0, 90.0, 0.0, 60.0, 0.0])


def bent(seed):
    """Return a random posture away from singularities of the position of the last link."""
    rng = np.random.default_rng(seed)
    spread = [2.0, 0.4, 0.8, 0.3, 1.0, 0.3, 1.0]
    return np.array([0.0, 0.5, 0.0, 1.4, 0.0, 1.0, 0.0]) + rng.uniform(-1.0, 1.0, 7) * spread


@pytest.mark.parametrize("seed", range(20))
def test_random_postures_and_pushes(lwr4, seed):
    """Stable, and with an observer the steady task error is less than a hundredth of the one without."""
    rng = np.random.default_rng(100 + seed)
    F = rng.normal(size=3)
    F *= 8.0 / np.linalg.norm(F)
    where = {"link": int(rng.integers(2, 5)), "p_LC": (0.0, 0.06, float(rng.uniform(0.05, 0.15)))}
    observer = ("momentum", "task_error")[seed % 2]
    none, kept = (Loop(lwr4, name, bent(seed)) for name in ("none", observer))
    expected, error = none.run(1.6, F, **where), kept.run(1.6, F, **where)
    assert np.all(np.isfinite(expected)) and np.all(np.isfinite(error))
    assert np.linalg.norm(none.v) < 1.0 and np.linalg.norm(kept.v) < 1.0
    assert expected[-1] > 100.0 * error[-1]


@pytest.mark.parametrize("seed", range(5))
def test_another_arm(load_arm, seed):
    """The same on an xArm7, for all that is read from its file."""
    test_random_postures_and_pushes(load_arm("xarm7"), seed)


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
    errors = loop.run(3.0, np.array([0.0, -3.0, 0.0]))
    assert np.all(np.isfinite(errors))
    limit = {"none": 0.03, "task_error_pd": 0.15}.get(observer, 2e-3)
    assert np.linalg.norm(loop.e.error) < limit


def test_rotation_error_is_a_logarithm():
    """log(exp(e)) = e up to half a turn, and its rate is that of finite differences."""
    rng = np.random.default_rng(0)
    for angle in (0.0, 1e-8, 1e-3, 1.0, 3.0, np.pi - 1e-9):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        e = rotation_log(axis_rotation(axis, angle))
        assert np.linalg.norm(e) == pytest.approx(angle, abs=1e-6)
        np.testing.assert_allclose(np.outer(e, e), angle**2 * np.outer(axis, axis), atol=1e-5)
    w_d, w, R, h = rng.normal(size=3), rng.normal(size=3), axis_rotation(np.array([0.0, 0.6, 0.8]), 0.9), 1e-6

    def turned(x, t):
        return axis_rotation(x / np.linalg.norm(x), np.linalg.norm(x) * t)

    ahead, behind = (rotation_log(turned(w_d, t) @ R @ turned(w, t).T) for t in (h, -h))
    np.testing.assert_allclose(rotation_rate(rotation_log(R), w_d, w), (ahead - behind) / (2 * h), atol=1e-6)


# ---- the system ----------------------------------------------------------------------------------------------------


class Ports:
    """A controller with all its inputs fixed."""

    def __init__(self, robot, **params):
        self.system = NullSpaceComplianceController(robot, NullSpaceComplianceParameters(**params))
        self.context, self.robot = self.system.CreateDefaultContext(), robot
        self.fix(q=robot.home, v=np.zeros(robot.n), residual=np.zeros(robot.n), torque_estimated=np.zeros(robot.n))

    def fix(self, q=None, v=None, **vectors):
        if q is not None:
            value = AbstractValue.Make(evaluate_dynamics(self.robot, q, v))
            self.system.GetInputPort("dynamics").FixValue(self.context, value)
        for name, value in vectors.items():
            self.system.GetInputPort(name).FixValue(self.context, value)

    def read(self, name, context=None):
        return np.array(self.system.GetOutputPort(name).Eval(context or self.context))

    def run(self, duration, context=None):
        context = context or self.context
        Simulator(self.system, context).AdvanceTo(context.get_time() + duration)


def test_terms_add_up_and_hold_needs_gravity_alone(lwr4):
    """At rest at home the command is gravity; the named terms always sum to command plus excess."""
    ports = Ports(lwr4)
    np.testing.assert_allclose(ports.read("torque_commanded"), evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g)
    rng = np.random.default_rng(1)
    ports.fix(lwr4.home + rng.uniform(-0.2, 0.2, 7), rng.uniform(-1, 1, 7), residual=rng.normal(size=7))
    total = ports.read("torque_commanded") + ports.read("torque_excess")
    np.testing.assert_allclose(ports.read("torque_terms").reshape(5, 7).sum(axis=0), total, atol=1e-12)


def test_desired_pose_and_limits(lwr4):
    """A desired pose shows as error in the world; a far one is limited, reported, and stops the observer."""
    ports = Ports(lwr4, observer="task_error")
    p = ports.system.kinematics(evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))).p

    def aim(offset):
        target = AbstractValue.Make(RigidTransform(RotationMatrix(), p + offset))
        ports.system.GetInputPort("desired_pose").FixValue(ports.context, target)

    aim(np.array([0.01, 0.0, -0.02]))
    np.testing.assert_allclose(ports.read("task_error"), [0.01, 0.0, -0.02], atol=1e-12)
    assert np.any(ports.read("observer_drive") != 0.0)
    aim(np.array([3.0, 0.0, 0.0]))
    assert np.all(np.abs(ports.read("torque_commanded")) <= lwr4.tau_max)
    assert np.any(ports.read("torque_excess") != 0.0)
    np.testing.assert_array_equal(ports.read("observer_drive"), np.zeros(7))


@pytest.mark.parametrize("observer", ["none", "momentum"])
def test_task_yields_above_the_threshold_smoothly_and_back(lwr4, observer):
    """Below the threshold nothing; above it the task term fades without a jump, and comes back after the release."""
    ports = Ports(lwr4, observer=observer, torque_threshold=30.0, threshold_band=5.0)
    ports.fix(residual=np.eye(7)[1] * 29.0)
    ports.run(0.1)
    assert ports.read("yielding")[0] == 0.0
    ports.fix(residual=np.eye(7)[1] * -40.0)
    steps = []
    for _ in range(300):
        steps.append((ports.read("yielding")[0], *ports.read("torque_commanded")))
        ports.run(0.002)
    steps = np.array(steps)
    assert np.all(np.diff(steps[:, 0]) >= 0.0) and steps[-1, 0] > 0.99
    assert np.abs(np.diff(steps, axis=0)).max() < 1.5
    ports.fix(residual=np.zeros(7))
    ports.run(2.0)
    assert ports.read("yielding")[0] == 0.0


def test_clone_goes_on_by_itself(lwr4):
    """What is remembered lives in the Context."""
    ports = Ports(lwr4, observer="momentum", torque_threshold=1.0)
    ports.run(0.01)
    twin = ports.context.Clone()
    ports.fix(residual=np.full(7, 100.0))
    ports.run(0.5)
    assert ports.read("yielding")[0] > 0.9 and ports.read("yielding", twin)[0] == 0.0
    ports.run(0.01, twin)
    np.testing.assert_array_equal(ports.read("task_error", twin), np.zeros(3))


def test_nan_and_missing_inputs_stop(lwr4):
    """NaN never becomes a torque; an observer without its input says which."""
    ports = Ports(lwr4, observer="momentum")
    ports.fix(residual=np.full(7, np.nan))
    with pytest.raises(StateError, match="not finite"):
        ports.read("torque_commanded")
    for observer, name in (("momentum", "residual"), ("task_error", "torque_estimated")):
        system = NullSpaceComplianceController(lwr4, NullSpaceComplianceParameters(observer=observer))
        context = system.CreateDefaultContext()
        with pytest.raises(StateError, match=name):
            _fixed(system, context, lwr4)


def _fixed(system, context, robot):
    value = AbstractValue.Make(evaluate_dynamics(robot, robot.home, np.zeros(robot.n)))
    system.GetInputPort("dynamics").FixValue(context, value)
    return system.GetOutputPort("torque_commanded").Eval(context)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"observer": "perfect"}, "none, task_error, task_error_pd, momentum"),
        ({"task": "elbow"}, "position, pose"),
        ({"K_x": -1.0}, "K_x"),
        ({"P": [1.0, 2.0]}, "P"),
        ({"torque_threshold": 0.0}, "torque_threshold"),
        ({"null_damping": [1.0, np.nan]}, "null_damping"),
    ],
)
def test_bad_parameters_are_named(change, words):
    with pytest.raises((ParameterError, UnknownNameError), match=words):
        NullSpaceComplianceParameters(**change)


def test_bad_gains_for_the_arm_are_named(lwr4):
    """γ against its sufficient condition, sizes against the joints, the frame against the model."""
    for change, words in (
        ({"observer": "task_error_pd", "gamma": 50.0}, "gamma: must be below"),
        ({"null_stiffness": [1.0, 2.0]}, "null_stiffness"),
    ):
        with pytest.raises(ParameterError, match=words):
            NullSpaceComplianceController(lwr4, NullSpaceComplianceParameters(**change))
    with pytest.raises(UnknownNameError, match="gripper"):
        NullSpaceComplianceController(lwr4, NullSpaceComplianceParameters(frame="gripper"))


# ---- the obstacles -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("obstacle", ["ball", "wall"])
def test_stiffness_of_the_obstacles(lwr4, obstacle):
    """Pressed by a known depth at rest, ball and pad push with stiffness times depth."""
    params = ObstacleCellParameters(obstacle=obstacle, time_step=1e-5)
    params.ball.dissipation = params.wall.dissipation = 0.0
    depth = 0.01
    if obstacle == "wall":
        params.wall.gap = 1e-12
    builder = DiagramBuilder()
    cell = add_obstacle_cell(builder, lwr4, params)
    builder.ExportInput(cell.torque_input, "torque")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.get_input_port(0).FixValue(context, np.zeros(7))
    plant = cell.plant
    own = plant.GetMyMutableContextFromRoot(context)
    if obstacle == "ball":
        plant.SetPositions(own, plant.GetModelInstanceByName("ball"), [params.ball.gap + depth])
        stiffness = params.ball.stiffness
    else:
        q = lwr4.home.copy()
        q[0] += 0.05
        plant.SetPositions(own, cell.instance, q)
        stiffness, depth = params.wall.stiffness, None
    Simulator(diagram, context).AdvanceTo(params.time_step)  # results are those of the last step
    results = plant.get_contact_results_output_port().Eval(own)
    assert results.num_point_pair_contacts() == 1
    info = results.point_pair_contact_info(0)
    measured = abs(info.contact_force() @ info.point_pair().nhat_BA_W)
    deep = info.point_pair().depth
    if depth is not None:
        assert deep == pytest.approx(depth, abs=1e-6)
    assert measured == pytest.approx(stiffness * deep, rel=0.01)


def test_travel_of_ball_and_path():
    """The ball reaches its stroke at its speed, dwells, and returns; the path is smooth and there and back."""
    p = BallParameters()
    assert ball_travel(p, p.start)[0] == 0.0
    assert ball_travel(p, p.arrival + 5.0) == (p.gap + p.stroke, 0.0)
    assert ball_travel(p, p.departure + 60.0) == (0.0, 0.0)
    motion, h = StraightMotionParameters(), 1e-6
    for t in (0.2, 1.0, 3.4, 3.9, 5.0, 8.0):
        s, rate, second = straight_motion(motion, t)
        assert 0.0 <= s <= 1.0
        after, before = straight_motion(motion, t + h), straight_motion(motion, t - h)
        assert rate == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-6)
        assert second == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-5)


def test_short_run_in_the_cell(lwr4):
    """Ball on the simulated arm with encoders, at 2 ms: the momentum observer keeps the task within 0.3 mm."""
    params = NullSpaceCellParameters()
    params.cell.ball.start, params.cell.ball.gap = 0.01, 0.002
    builder = DiagramBuilder()
    parts = add_null_space_cell(builder, lwr4, params)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.5)
    context = parts.controller.GetMyContextFromRoot(simulator.get_context())
    assert np.linalg.norm(parts.controller.GetOutputPort("task_error").Eval(context)) < 5e-4
    own = parts.momentum.GetMyContextFromRoot(simulator.get_context())
    residual = parts.momentum.GetOutputPort("residual").Eval(own)
    assert np.abs(residual).max() > 1.0


def test_friction_sticks_and_payload_weighs(lwr4):
    """A joint whose load is below its Coulomb friction stays at rest; the payload adds its weight to what is felt."""
    for payload in (0.0, 1.0):
        params = NullSpaceCellParameters()
        params.cell.obstacle, params.cell.friction_share, params.cell.payload = "nothing", 1.0, payload
        builder = DiagramBuilder()
        parts = add_null_space_cell(builder, lwr4, params)
        diagram = builder.Build()
        simulator = Simulator(diagram)
        simulator.AdvanceTo(0.1)
        state = parts.cell.robot_state.Eval(parts.cell.plant.GetMyContextFromRoot(simulator.get_context()))
        moved = np.abs(state[:7] - lwr4.home).max()
        assert moved < 1e-9 if payload == 0.0 else moved < 1e-4
