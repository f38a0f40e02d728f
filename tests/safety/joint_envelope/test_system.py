"""The envelope in a diagram: whatever commands the arm, and when state or command are not known."""

import numpy as np
import pytest
from bench import Bench
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem

from saphari_drake.errors import ParameterError
from saphari_drake.messages import SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus, Motion, limited_torque, predicted
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters, envelope_of
from saphari_drake.safety.joint_envelope.system import JointEnvelope
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.plant import torque_input

STEP = 0.001


class Command(LeafSystem):
    """A controller that may do anything: `torque` is a function of the time."""

    def __init__(self, torque):
        super().__init__()
        self.DeclareVectorOutputPort(
            "torque",
            BasicVector(len(torque(0.0))),
            lambda context, output: output.SetFromVector(torque(context.get_time())),
            prerequisites_of_calc={self.time_ticket()},
        )


def run(robot, torque, duration, exact=False, stale_time=np.inf):
    """Return samples (speeds, torques, status) at each ms of the arm that `torque` commands through the envelope."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(STEP))
    arm = robot.add_to(plant)
    plant.Finalize()
    plant.SetDefaultPositions(arm, robot.home)
    encoders = JointSensorParameters(STEP, 0.0, 0.0, False) if exact else JointSensorParameters(STEP)
    params = JointEnvelopeParameters(velocity_age=0.0 if exact else 0.5 * STEP, stale_time=stale_time)
    sensor = builder.AddSystem(JointSensor(robot, encoders))
    envelope = builder.AddSystem(JointEnvelope(robot, params))
    command = builder.AddSystem(Command(torque))
    builder.Connect(plant.get_state_output_port(arm), sensor.GetInputPort("state"))
    for name in ("position_measured", "velocity_measured"):
        builder.Connect(sensor.GetOutputPort(name), envelope.GetInputPort(name))
    builder.Connect(command.GetOutputPort("torque"), envelope.GetInputPort("torque_commanded"))
    builder.Connect(envelope.GetOutputPort("torque_applied"), torque_input(builder, robot, plant, arm))
    simulator = Simulator(builder.Build())
    context, samples = simulator.get_context(), []
    for k in range(1, int(duration / STEP)):
        simulator.AdvanceTo(k * STEP + 0.5 * STEP)
        own = envelope.GetMyContextFromRoot(context)
        values = [
            envelope.GetOutputPort(name).Eval(own)
            for name in ("torque_applied", "torque_excess", "status", "system_status")
        ]
        own = plant.GetMyContextFromRoot(context)
        samples.append((plant.GetVelocities(own), *values, plant.GetPositions(own)))
    return [np.array(column) for column in zip(*samples)]


@pytest.mark.parametrize("seed", range(3))
def test_noise_at_full_torque_spins_no_joint(lwr4, seed):
    rng = np.random.default_rng(seed)
    held = rng.uniform(-1.0, 1.0, (50, 7)) * 2.0 * lwr4.tau_max
    v, torque, _, status, _, _ = run(lwr4, lambda t: held[int((t + 0.0007) / 0.02) % 50], 1.0)  # between two periods
    assert np.max(np.abs(v) / lwr4.v_max) < 1.0
    assert np.all(np.abs(torque) <= lwr4.tau_max)
    assert np.max(np.abs(np.diff(torque, axis=0))) <= 1000.0 * STEP * (1.0 + 1e-9)
    assert set(status.ravel()) & {EnvelopeStatus.SPEED, EnvelopeStatus.POSITION}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["noise", "constant", "nothing"])
@pytest.mark.parametrize("name", ["lwr4", "panda"])
def test_a_controller_that_goes_mad_at_a_random_time_leaves_no_limit(load_arm, name, kind, seed):
    """It bears the weight at home until then; afterwards full torque at random, one torque, or none, within limits."""
    robot, rng = load_arm(name), np.random.default_rng(seed)
    robot = robot.with_home(0.5 * (robot.q_min + robot.q_max))  # the Panda's own is outside its limits
    begin, weight = rng.uniform(0.05, 0.4), evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).g
    noise = rng.uniform(-1.0, 1.0, (2000, robot.n)) * robot.tau_max
    mad = {"noise": noise, "constant": np.sign(noise[:1]) * robot.tau_max, "nothing": np.zeros((1, robot.n))}[kind]

    def torque(t):
        k = int((t + 0.0007) / STEP)  # between two periods
        return weight if k * STEP < begin else mad[k % len(mad)]

    v, applied, *_, q = run(robot, torque, 1.2, exact=True)
    assert np.max(np.abs(v) / robot.v_max) <= (1.0 if name == "lwr4" else 1.01)  # all at full speed: beyond speed_share
    assert np.all((robot.q_min <= q) & (q <= robot.q_max))
    assert np.all(np.abs(applied) <= robot.tau_max)
    assert np.max(np.abs(np.diff(applied, axis=0))) <= 1000.0 * STEP * (1.0 + 1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_without_a_command_the_posture_is_held_and_it_is_told(lwr4, bad):
    """And the envelope goes on when the command is known again."""
    weight = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g

    def torque(t):
        return np.full(7, bad) if 0.05 < t < 0.50 else weight + [3.0 * np.sin(40.0 * t), 0, 0, 0, 0, 0, 0]

    v, applied, excess, status, system_status, q = run(lwr4, torque, 0.6)
    lost = status[:, 0] == EnvelopeStatus.BAD_INPUT
    np.testing.assert_array_equal(lost, system_status[:, 0] == SystemStatus.HOLDING)
    assert 448 <= lost.sum() <= 452
    assert np.isfinite(applied).all() and np.isfinite(excess).all()
    began, end = np.flatnonzero(lost)[[0, -1]]
    assert np.abs(v[began]).max() > 0.02  # it moved
    assert np.abs(q[end] - q[began]).max() < 1e-3 and np.abs(v[end]).max() < 5e-3
    assert not lost[-50:].any()


def test_a_command_that_is_frozen_while_the_arm_moves_comes_from_a_dead_controller(lwr4):
    """Within the stale time it holds where that was noticed; before, it was on its way down under no torque."""
    _, _, _, _, status, q = run(lwr4, lambda t: np.zeros(7), 1.0, stale_time=0.03)
    dead = np.flatnonzero(status[:, 0] == SystemStatus.HOLDING)
    assert dead[0] == pytest.approx(31, abs=2) and len(dead) == len(status) - dead[0]
    assert np.abs(q[-1] - q[dead[0]]).max() < 1e-3


def test_a_frozen_command_of_an_arm_at_rest_is_none_of_a_dead_controller(lwr4):
    weight = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g
    *_, status, _ = run(lwr4, lambda t: weight, 0.3, stale_time=0.03)
    assert np.all(status == SystemStatus.OK)


def resting(robot, params=None):
    """Return the bench of an envelope of an arm that rests at home under its weight (n,), and that weight."""
    weight, zero = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).g, np.zeros(robot.n)
    envelope = JointEnvelope(robot, params)
    return Bench(envelope, position_measured=robot.home, velocity_measured=zero, torque_commanded=weight), weight


def test_an_unknown_state_leaves_torque_and_rate_limited(lwr4):
    bench, weight = resting(lwr4)
    bench.set(position_measured=np.full(7, np.nan), torque_commanded=np.full(7, 1e3))
    np.testing.assert_allclose(bench.read("torque_applied"), np.minimum(weight + 1.0, lwr4.tau_max))
    assert bench.read("status") == EnvelopeStatus.BAD_INPUT
    assert bench.read("system_status") == SystemStatus.BAD_INPUT


def test_a_frozen_command_is_held_against_where_the_state_is_known_again(lwr4):
    """Not where it was not."""
    bench, _ = resting(lwr4, JointEnvelopeParameters(stale_time=0.003))
    for k in range(10):
        bench.set(velocity_measured=np.full(7, np.nan if k < 7 else 0.01 * k))
        bench.simulator.AdvanceTo((k + 1) * STEP + 2e-6)
        assert np.isfinite(bench.read("torque_applied")).all()
    assert bench.read("system_status") == SystemStatus.HOLDING


def test_the_mean_torque_is_that_at_the_joints(lwr4):
    """Delayed, over the last window."""
    bench, weight = resting(lwr4, JointEnvelopeParameters(torque_delay=0.002, mean_time=0.003, period=0.005 / 5))
    given = [weight] * 5
    for k in range(20):
        bench.set(torque_commanded=weight + 0.3 * np.sin(k + np.arange(7)))
        given.append(bench.read("torque_applied"))
        np.testing.assert_allclose(bench.read("torque_mean"), np.mean(given[-5:-2], axis=0))
        bench.simulator.AdvanceTo((k + 1) * STEP + 2e-6)


def test_a_known_delay_keeps_the_speed_within_its_limit(lwr4):
    """The torque waits two periods; without knowing it the envelope is left."""
    speeds = [delayed(lwr4, known) for known in (0.0, 0.002)]
    assert speeds[0] > 1.0
    assert speeds[1] < 1.0


def delayed(robot, known):
    """Return the largest share of a speed limit under torques of a fixed kind that act 2 ms late."""
    params = JointEnvelopeParameters(torque_delay=known, velocity_age=0.0)
    envelope, rng = envelope_of(robot, params), np.random.default_rng(0)
    q, v = robot.home.copy(), np.zeros(7)
    terms = evaluate_dynamics(robot, q, v)
    torques, worst = [terms.g] * 10, 0.0
    for k in range(600):
        if k % 100 == 0:
            wish = rng.choice([-1.0, 1.0], 7) * robot.tau_max
        terms = evaluate_dynamics(robot, q, v)
        motion = Motion(q, v, terms.M, terms.Cv + terms.g, np.zeros(7), torques[-1])
        ahead = predicted(envelope, motion, np.array(torques[-5:]), params.periods("torque_delay"), 0.0)
        torques.append(limited_torque(envelope, ahead, wish).torque)
        v = v + STEP * np.linalg.solve(terms.M, torques[-3] - terms.Cv - terms.g)
        q = q + STEP * v
        worst = max(worst, np.max(np.abs(v) / robot.v_max))
    return worst


@pytest.mark.parametrize("name", ["torque_delay", "mean_time"])
def test_times_are_whole_periods(name):
    with pytest.raises(ParameterError, match=name):
        JointEnvelopeParameters(**{name: 0.0015})


def test_viscous_friction_is_no_acceleration(load_arm):
    """A torque that keeps an arm with the friction of its file at one speed passes as it is, a light wrist's too."""
    robot = load_arm("xarm7")
    v, home = np.full(robot.n, 0.03), robot.home + [0.0, 0.0, 0.0, 0.5, 0.0, 0.5, 0.0]
    terms = evaluate_dynamics(robot, home, v)
    torque = terms.Cv + terms.g + robot.viscous * v
    system = JointEnvelope(robot, JointEnvelopeParameters(velocity_age=0.0))
    bench = Bench(system, position_measured=home, velocity_measured=v, torque_commanded=torque)
    assert robot.viscous.min() > 1.0
    np.testing.assert_allclose(bench.read("torque_excess"), 0.0, atol=1e-12)
