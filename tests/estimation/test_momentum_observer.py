"""The residual follows the external torque at its rate, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from bench import PERIOD, Bench
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters, discrete_gain
from saphari_drake.messages import SystemStatus
from saphari_drake.robots.dynamics import RobotDynamics, evaluate_dynamics
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters

GAINS = np.array([10.0, 20.0, 30.0, 50.0, 70.0, 90.0, 100.0])
F_W = np.array([10.0, -20.0, 5.0])


class ExactWorld:
    """Feeds an observer with momentum that obeys p⁺ = p + T(τ + Cᵀq̇ − g + JᵀF), all other terms random."""

    def __init__(self, robot, gain=50.0, seed=0):
        self.rng = np.random.default_rng(seed)
        self.start = evaluate_dynamics(robot, robot.home, np.zeros(7))
        self.J = self.start.point(5, np.array([0.0, 0.0, 0.05])).Jv_WC
        self.p = self.rng.normal(size=7)
        observer = MomentumObserver(robot, MomentumObserverParameters(gain=gain))
        self.observer = Bench(observer, dynamics=self.terms(), torque_applied=np.zeros(7))

    def terms(self):
        self.CTv, self.g = self.rng.normal(size=(2, 7)) * 20.0
        return replace(self.start, p=self.p, CTv=self.CTv, g=self.g)

    def step(self, torque_external):
        """Go on by one period; return the residual."""
        torque = self.rng.normal(size=7) * 20.0
        self.observer.run(torque_applied=torque)
        self.p = self.p + PERIOD * (torque + self.CTv - self.g + torque_external)
        self.observer.set(dynamics=self.terms())
        return self.observer.read("torque_external")


def test_residual_starts_at_zero_whatever_the_momentum(lwr4):
    """The text assumes a robot at rest; here it may move."""
    world = ExactWorld(lwr4)
    assert np.linalg.norm(world.p) > 1.0
    np.testing.assert_array_equal(world.observer.read("torque_external"), 0.0)


@pytest.mark.parametrize("gain", [50.0, 1000.0, list(GAINS)])
def test_step_response_has_the_exact_rate_at_every_sample(lwr4, gain):
    """r = (1 − e^{−K_I t}) JᵀF, each joint with its own gain, also where K_I T is far from small."""
    world, rate = ExactWorld(lwr4, gain), np.broadcast_to(gain, 7)
    f = world.J.T @ F_W
    for k in range(1, 100):
        np.testing.assert_allclose(world.step(f), -np.expm1(-rate * k * PERIOD) * f, atol=1e-10)


def test_no_steady_error(lwr4):
    """After a long constant force, r = JᵀF."""
    world = ExactWorld(lwr4)
    f = world.J.T @ F_W
    for _ in range(200):
        r = world.step(f)
    np.testing.assert_allclose(r, f, atol=1e-9)


def test_linear_filter_of_any_external_torque(lwr4):
    """r⁺ = e^{−K_I T} r + (1 − e^{−K_I T}) JᵀF for a force that changes every cycle; zero force leaves zero."""
    world, expected, decay = ExactWorld(lwr4), np.zeros(7), np.exp(-50.0 * PERIOD)
    for _ in range(100):
        f = world.J.T @ world.rng.normal(size=3) * 30.0
        expected = decay * expected + (1.0 - decay) * f
        np.testing.assert_allclose(world.step(f), expected, atol=1e-10)


def test_discrete_gain_tends_to_the_continuous_one(lwr4):
    np.testing.assert_allclose(discrete_gain(GAINS, 1e-9), GAINS, rtol=1e-6)
    assert np.all(discrete_gain(1e6 * GAINS, PERIOD) <= 1.0 / PERIOD)


def test_clone_of_the_context_goes_on_by_itself(lwr4):
    world = ExactWorld(lwr4)
    for _ in range(5):
        world.step(np.ones(7))
    twin, r = world.observer.clone(), world.observer.read("torque_external")
    twin.run(torque_applied=np.ones(7))
    assert np.max(np.abs(twin.read("torque_external") - r)) > 1e-3
    np.testing.assert_array_equal(world.observer.read("torque_external"), r)
    world.observer.run(torque_applied=np.ones(7))
    np.testing.assert_array_equal(world.observer.read("torque_external"), twin.read("torque_external"))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("cycles", [1, 30])
@pytest.mark.parametrize("port", ["dynamics", "torque_applied"])
def test_starts_anew_after_an_input_that_is_not_finite(lwr4, port, cycles, bad):
    """It says so while the state is not known, keeps no NaN, and then finds the torque again at its rate."""
    world, f = ExactWorld(lwr4), np.ones(7)
    for _ in range(50):
        world.step(f)
    bench = world.observer
    bench.set(**{port: world.start.unknown() if port == "dynamics" else np.r_[bad, np.zeros(6)]})
    bench.run(cycles)
    unknown = port == "dynamics"
    assert np.isnan(bench.read("torque_external")).all() == unknown
    assert bench.read("system_status") == (SystemStatus.BAD_INPUT if unknown else SystemStatus.OK)
    bench.set(dynamics=world.terms())
    np.testing.assert_array_equal(bench.read("torque_external"), 0.0)
    for k in range(1, 100):
        np.testing.assert_allclose(world.step(f), -np.expm1(-50.0 * k * PERIOD) * f, atol=1e-10)


# ---- with a simulated arm ------------------------------------------------------------------------------------------


def simulate(robot, period, torque, torque_external, duration=0.3):
    """Drive a continuous plant by constant torques; return times, residuals and momenta."""
    builder = DiagramBuilder()
    plant = MultibodyPlant(0.0)
    instance = robot.add_to(plant)
    plant.Finalize()
    plant.SetDefaultPositions(robot.home)
    builder.AddSystem(plant)
    exact = JointSensorParameters(period=period, position_resolution=0.0, differentiate=False)
    sensor, dynamics = builder.AddSystem(JointSensor(robot, exact)), builder.AddSystem(RobotDynamics(robot))
    observer = builder.AddSystem(MomentumObserver(robot, MomentumObserverParameters(period=period)))
    command = builder.AddSystem(ConstantVectorSource(torque))
    external = builder.AddSystem(ConstantVectorSource(torque_external))
    builder.Connect(command.get_output_port(), plant.get_actuation_input_port(instance))
    builder.Connect(command.get_output_port(), observer.GetInputPort("torque_applied"))
    builder.Connect(external.get_output_port(), plant.get_applied_generalized_force_input_port())
    builder.Connect(plant.get_state_output_port(instance), sensor.GetInputPort("state"))
    for name in ("position_measured", "velocity_measured"):
        builder.Connect(sensor.GetOutputPort(name), dynamics.GetInputPort(name))
    builder.Connect(dynamics.GetOutputPort("dynamics"), observer.GetInputPort("dynamics"))
    diagram = builder.Build()
    simulator, rows = Simulator(diagram), []
    simulator.get_mutable_integrator().set_target_accuracy(1e-6)

    def record(root):
        context = observer.GetMyContextFromRoot(root)
        p = observer.GetInputPort("dynamics").Eval(context).p
        rows.append(np.r_[root.get_time(), observer.GetOutputPort("torque_external").Eval(context), p])

    for k in range(1, round(duration / period) + 1):
        simulator.AdvanceTo(k * period + 2e-6)
        record(simulator.get_context())
    data = np.array(rows)
    return data[:, 0], data[:, 1:8], data[:, 8:]


@pytest.fixture(scope="module")
def swing(lwr4):
    """Torques that swing the arm about."""
    return evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g + np.array([6.0, -8.0, 4.0, 5.0, 0.5, 0.3, 0.02])


def test_no_residual_in_free_motion(lwr4, swing):
    """Only the sampling of Cᵀq̇ − g is left: in proportion to the period, and below half the usual threshold at 5 ms."""
    largest = []
    for period in (0.005, 0.001):
        _, r, p = simulate(lwr4, period, swing, np.zeros(7))
        assert np.max(np.abs(p)) > 1.0
        largest.append(np.max(np.abs(r)))
    assert largest[0] < 0.5
    assert largest[1] < 0.25 * largest[0]


def test_residual_finds_an_external_torque_in_motion(lwr4, swing):
    """r follows (1 − e^{−K_I t}) of the torque while the arm swings."""
    f = np.array([3.0, -2.0, 2.0, 1.5, -0.3, 0.2, 0.02])
    t, r, _ = simulate(lwr4, 0.001, swing, f)
    np.testing.assert_allclose(r, -np.expm1(-50.0 * t)[:, None] * f, atol=0.1)


# ---- parameters ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "value"), [("gain", 0.0), ("gain", [50.0, -1.0]), ("period", 0.0)])
def test_bad_parameters(name, value):
    with pytest.raises(ParameterError, match=name):
        MomentumObserverParameters(**{name: value})


def test_gains_of_the_wrong_size(lwr4):
    with pytest.raises(ParameterError, match="gain: needs 1 or 7 entries"):
        MomentumObserver(lwr4, MomentumObserverParameters(gain=[50.0, 50.0]))


@pytest.mark.parametrize("cycles", [0.0, 0.5, 1.0, 1.6, 2.0])
def test_a_delay_that_is_told_leaves_no_trace(lwr4, cycles):
    """Torque that acts later, by whole periods or not: the residual is that of the external torque alone."""
    start, rng = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)), np.random.default_rng(0)
    terms = replace(start, p=np.zeros(7), CTv=np.zeros(7), g=np.zeros(7))
    observer = MomentumObserver(lwr4, MomentumObserverParameters(gain=50.0, torque_delay=cycles * PERIOD))
    bench = Bench(observer, dynamics=terms, torque_applied=np.zeros(7))
    p, torques, whole = np.zeros(7), [np.zeros(7)] * 4, int(cycles)
    for k in range(1, 40):
        torques.append(rng.normal(size=7) if k > 3 else np.zeros(7))
        bench.run(torque_applied=torques[-1])
        share = cycles - whole
        p = p + PERIOD * ((1.0 - share) * torques[-1 - whole] + share * torques[-2 - whole] + F_W[0])
        bench.set(dynamics=replace(terms, p=p))
        expected = -np.expm1(-50.0 * k * PERIOD) * F_W[0]
        np.testing.assert_allclose(bench.read("torque_external"), expected, atol=1e-9)


@pytest.mark.parametrize(("fields", "name"), [({"torque_delay": np.nan}, "torque_delay"),
                                              ({"torque_delay": -0.001}, "torque_delay"),
                                              ({"velocity_delay": -0.5}, "velocity_delay")])  # fmt: skip
def test_bad_delays(fields, name):
    with pytest.raises(ParameterError, match=name):
        MomentumObserverParameters(**fields)
