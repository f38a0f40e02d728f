"""The velocity servo: its closed loop on the plant, its state."""

import numpy as np
import pytest
from arms import states
from bench import Bench
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.control.joint_servo import JointServoParameters, JointVelocityServo, servo_torque
from saphari_drake.errors import ParameterError
from saphari_drake.messages import SystemStatus
from saphari_drake.robots.catalog import omnirob
from saphari_drake.robots.dynamics import RobotDynamics, evaluate_dynamics
from saphari_drake.safety.velocity_envelope.law import Course, limited_velocity
from saphari_drake.safety.velocity_envelope.parameters import VelocityEnvelopeParameters, bounds_of
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell

RATE, T = 3.0e4, 0.001  # N/s (Nm/s), s


@pytest.mark.parametrize("arm", ["lwr4", "panda", "mobile"])
def test_the_law_gives_the_acceleration_it_asks_for(load_arm, arm):
    """M q̈ + C q̇ + g = τ with q̈ = a_d + K (q̇_d − q̇)."""
    robot = load_arm(arm)
    rng = np.random.default_rng(0)
    for q, v in states(robot, 3):
        terms = evaluate_dynamics(robot, q, v)
        v_d, a_d = rng.standard_normal((2, robot.n))
        torque = servo_torque(terms, v_d, a_d, 50.0)
        acceleration = np.linalg.solve(terms.M, torque - terms.Cv - terms.g)
        np.testing.assert_allclose(acceleration, a_d + 50.0 * (v_d - v), atol=1e-7)


@pytest.mark.parametrize("arm", ["lwr4", "xarm7"])
def test_the_plant_follows_a_velocity_command(load_arm, arm):
    """Started at rest: the error falls by 1/e each 1/K, and nothing of gravity, Coriolis and friction is left.

    The friction of the xArm7's joints is far above what the gain does to its light wrist, and quickens it.
    """
    robot = load_arm(arm)
    command = np.array([0.3, -0.2, 0.4, 0.3, -0.5, 0.4, 0.6])
    params = JointServoParameters(gain=50.0, feedforward=0.0)
    builder = DiagramBuilder()
    cell = add_cell(builder, robot)
    sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(0.001, differentiate=False)))
    dynamics, servo = builder.AddSystem(RobotDynamics(robot)), builder.AddSystem(JointVelocityServo(robot, params))
    source = builder.AddSystem(ConstantVectorSource(command))
    builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
    for name in ("position_measured", "velocity_measured"):
        builder.Connect(sensor.GetOutputPort(name), dynamics.GetInputPort(name))
    builder.Connect(dynamics.GetOutputPort("dynamics"), servo.GetInputPort("dynamics"))
    builder.Connect(source.get_output_port(), servo.GetInputPort("velocity_commanded"))
    builder.Connect(servo.GetOutputPort("torque_commanded"), cell.torque_input)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    shares = []
    for time in (0.02, 0.3):
        simulator.AdvanceTo(time)
        v = cell.robot_state.Eval(cell.plant.GetMyContextFromRoot(simulator.get_context()))[robot.n :]
        shares.append(np.abs(command - v) / np.abs(command))
    if not robot.viscous.any():
        np.testing.assert_allclose(shares[0], np.exp(-1.0), atol=0.08)
    assert shares[1].max() < 0.005


def test_at_rest_it_carries_gravity_and_a_constant_command_feeds_nothing_forward(lwr4):
    servo = JointVelocityServo(lwr4)
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    bench = Bench(servo, dynamics=terms, velocity_commanded=np.zeros(7))
    np.testing.assert_allclose(bench.read("torque_commanded"), terms.g, atol=1e-12)
    moving = evaluate_dynamics(lwr4, lwr4.home, np.full(7, 0.1))
    bench.run(1, dynamics=moving, velocity_commanded=np.full(7, 0.1))
    np.testing.assert_allclose(bench.read("torque_commanded"), moving.Cv + moving.g, atol=1e-12)


def test_the_first_command_is_not_fed_forward(lwr4):
    """A command that does not start at zero asks for K q̇_d once, not for the step divided by the period."""
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    command = np.full(7, 0.05)
    bench = Bench(JointVelocityServo(lwr4), dynamics=terms, velocity_commanded=command)
    np.testing.assert_allclose(bench.read("torque_commanded"), terms.M @ (150.0 * command) + terms.g, atol=1e-9)
    bench.run(1)
    bench.set(velocity_commanded=2.0 * command)
    expected = terms.M @ (command / 0.001 + 300.0 * command) + terms.g
    np.testing.assert_allclose(bench.read("torque_commanded"), expected, atol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_command_that_is_not_finite_brakes(lwr4, bad):
    """K times the measured velocity is taken out, nothing is fed forward, then or in the next good cycle."""
    moving = evaluate_dynamics(lwr4, lwr4.home, np.full(7, 0.1))
    bench = Bench(JointVelocityServo(lwr4), dynamics=moving, velocity_commanded=moving.v)
    bench.run(velocity_commanded=np.r_[bad, moving.v[1:]])
    expected = moving.M @ (-150.0 * moving.v) + moving.Cv + moving.g
    assert bench.read("system_status") == SystemStatus.BAD_INPUT
    np.testing.assert_allclose(bench.read("torque_commanded"), expected)
    bench.set(velocity_commanded=moving.v)
    assert bench.read("system_status") == SystemStatus.OK
    np.testing.assert_allclose(bench.read("torque_commanded"), moving.Cv + moving.g, atol=1e-12)


def test_a_state_that_is_not_known_leaves_the_gravity_torque_of_the_last_one(lwr4):
    terms = evaluate_dynamics(lwr4, lwr4.home + 0.1, np.zeros(7))
    bench = Bench(JointVelocityServo(lwr4), dynamics=terms.unknown(), velocity_commanded=np.ones(7))
    np.testing.assert_array_equal(bench.read("torque_commanded"), evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g)
    bench.run(dynamics=terms)
    bench.run(dynamics=terms.unknown())
    assert bench.read("system_status") == SystemStatus.BRAKES_ON
    np.testing.assert_array_equal(bench.read("torque_commanded"), terms.g)
    bench.run(dynamics=terms)
    assert bench.read("system_status") == SystemStatus.OK


@pytest.mark.parametrize("field", ["gain", "period", "feedforward"])
def test_parameters_are_checked(field):
    with pytest.raises(ParameterError, match=field):
        JointServoParameters(**{field: -1.0})


@pytest.mark.parametrize(("integral_gain", "left"), [(0.0, 0.03), (625.0, 0.002)])
def test_the_integral_takes_out_what_a_constant_torque_holds_back(lwr4, integral_gain, left):
    """A friction of 0.1 Nm that nobody knows: without the integral the wrist stays slow by f/(M K)."""
    servo = JointVelocityServo(lwr4, JointServoParameters(gain=50.0, integral_gain=integral_gain))
    bench, q, v = Bench(servo), lwr4.home.copy(), np.zeros(7)
    wanted, friction = np.full(7, 0.1), 0.1
    for k in range(500):
        terms = evaluate_dynamics(lwr4, q, v)
        bench.set(dynamics=terms, velocity_commanded=wanted)
        bench.simulator.AdvanceTo(0.001 * (k + 1) + 2e-6)
        torque = bench.read("torque_commanded") - friction * np.tanh(v / 1e-3)
        v = v + 0.001 * np.linalg.solve(terms.M, torque - terms.Cv - terms.g)
        q = q + 0.001 * v
    assert (np.abs(wanted - v).max() < left) == (integral_gain > 0.0)


@pytest.mark.parametrize("given", [True, False])
def test_the_integral_does_not_wind_up_while_another_torque_acts(lwr4, given):
    """Held fast for half a second and told that its torque does not act, it asks for no more than at the start."""
    servo = JointVelocityServo(lwr4, JointServoParameters(gain=50.0, integral_gain=625.0))
    bench, terms = Bench(servo), evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    bench.set(dynamics=terms, velocity_commanded=np.full(7, 0.1), torque_applied=terms.g)
    first = bench.read("torque_commanded")
    for k in range(500):
        bench.set(torque_applied=bench.read("torque_commanded") if given else terms.g)
        bench.simulator.AdvanceTo(0.001 * (k + 1) + 2e-6)
    more = np.abs(bench.read("torque_commanded") - first).max()
    assert (more > 1.0) == given
    assert given or more < 1e-9


def speeds_of_a_stop(known):
    """Return the velocities of the platform (k, 2) from 0.3 m/s on, its drives slower than the servo asks for."""
    robot = omnirob()
    bounds = bounds_of(robot, VelocityEnvelopeParameters(torque_rate=RATE if known else np.inf))
    servo = JointVelocityServo(robot, JointServoParameters(gain=100.0, integral_gain=2500.0))
    q, v, course = robot.home.copy(), np.zeros(robot.n), Course(robot.home, np.zeros(robot.n), np.zeros(robot.n))
    torque, rows = evaluate_dynamics(robot, q, v).g, []
    bench = Bench(servo, dynamics=evaluate_dynamics(robot, q, v), velocity_commanded=v, torque_applied=torque)
    for k in range(1200):
        wish = np.zeros(robot.n)
        wish[:2] = (0.3, -0.3) if k < 500 else (0.0, 0.0)
        course = limited_velocity(bounds, course, q, wish)[0]
        terms = evaluate_dynamics(robot, q, v)
        bench.set(dynamics=terms, velocity_commanded=course.v)
        asked = np.clip(bench.read("torque_commanded"), -robot.tau_max, robot.tau_max)
        torque = np.clip(asked, torque - RATE * T, torque + RATE * T)
        if known:
            bench.set(torque_applied=torque)
        else:
            bench.set(torque_applied=bench.read("torque_commanded"))
        bench.simulator.AdvanceTo(T * (k + 1) + 2e-6)
        v = v + T * np.linalg.solve(terms.M, torque - terms.Cv - terms.g)
        q = q + T * v
        rows.append(v[:2])
    return np.array(rows)


@pytest.mark.parametrize("known", [True, False])
def test_a_stop_does_not_swing(known):
    """With the rate of its drives known, it stands 0.3 s after the command and hardly runs back; else it swings."""
    v = speeds_of_a_stop(known)
    back, late = -min(v[500:, 0].min(), -v[500:, 1].max()), np.abs(v[800:]).max()
    assert (back < 0.01) == known
    assert (late < 0.005) == known
