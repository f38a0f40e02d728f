"""The envelope in a diagram: whatever commands the arm, and when state or command are not known."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem

from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus
from saphari_drake.safety.joint_envelope.system import JointEnvelope
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters

STEP = 0.001


class Command(LeafSystem):
    """A controller that may do anything: `torque` is a function of the time."""

    def __init__(self, torque):
        super().__init__()
        self.DeclareVectorOutputPort(
            "torque",
            BasicVector(7),
            lambda context, output: output.SetFromVector(torque(context.get_time())),
            prerequisites_of_calc={self.time_ticket()},
        )


def run(robot, torque, duration):
    """Return samples (speeds, torques, status) at each ms of the arm that `torque` commands through the envelope."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(STEP))
    arm = robot.add_to(plant)
    plant.Finalize()
    plant.SetDefaultPositions(arm, robot.home)
    sensor = builder.AddSystem(JointSensor(robot, JointSensorParameters(STEP)))
    dynamics, envelope = builder.AddSystem(RobotDynamics(robot)), builder.AddSystem(JointEnvelope(robot))
    command = builder.AddSystem(Command(torque))
    builder.Connect(plant.get_state_output_port(arm), sensor.GetInputPort("state"))
    for name in ("position_measured", "velocity_measured"):
        builder.Connect(sensor.GetOutputPort(name), dynamics.GetInputPort(name))
    builder.Connect(dynamics.GetOutputPort("dynamics"), envelope.GetInputPort("dynamics"))
    builder.Connect(command.GetOutputPort("torque"), envelope.GetInputPort("torque_commanded"))
    builder.Connect(envelope.GetOutputPort("torque_applied"), plant.get_actuation_input_port(arm))
    simulator = Simulator(builder.Build())
    context, samples = simulator.get_context(), []
    for k in range(1, int(duration / STEP)):
        simulator.AdvanceTo(k * STEP + 0.5 * STEP)
        own = envelope.GetMyContextFromRoot(context)
        values = [envelope.GetOutputPort(name).Eval(own) for name in ("torque_applied", "torque_excess", "status")]
        samples.append((plant.GetVelocities(plant.GetMyContextFromRoot(context)), *values))
    return [np.array(column) for column in zip(*samples)]


@pytest.mark.parametrize("seed", range(3))
def test_noise_at_full_torque_spins_no_joint(lwr4, seed):
    rng = np.random.default_rng(seed)
    held = rng.uniform(-1.0, 1.0, (50, 7)) * 2.0 * lwr4.tau_max
    v, torque, _, status = run(lwr4, lambda t: held[int(t / 0.02) % 50], 1.0)
    assert np.max(np.abs(v) / lwr4.v_max) < 1.02  # the sensor tells of the state one step ago
    assert np.all(np.abs(torque) <= lwr4.tau_max)
    assert np.max(np.abs(np.diff(torque, axis=0))) <= 1000.0 * STEP * (1.0 + 1e-9)
    assert set(status.ravel()) & {EnvelopeStatus.SPEED, EnvelopeStatus.POSITION}


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_command_that_is_not_known_keeps_the_torque_and_is_told(lwr4, bad):
    """And the envelope goes on when the command is known again."""

    def torque(t):
        return np.full(7, bad) if 0.05 < t < 0.10 else np.zeros(7)

    _, applied, excess, status = run(lwr4, torque, 0.2)
    lost = status[:, 0] == EnvelopeStatus.BAD_INPUT
    assert 48 <= lost.sum() <= 52
    assert np.isfinite(applied).all() and np.isfinite(excess).all()
    np.testing.assert_array_equal(np.diff(applied[lost], axis=0), 0.0)
    assert not lost[-50:].any()
