"""A platform that cannot slip sideways: its commands, and the force of its wheels on the simulated plant."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.control.platform_twist import PlatformTwist, lateral_slip, without_slip
from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.wheels import Wheels, wheel_force

BASE = ("px", "py", "pz")
STEP = 0.001


@pytest.fixture(scope="module")
def omnirob():
    return catalog.omnirob()


def test_command_has_no_lateral_part_and_keeps_the_rest():
    """The platform's command lies along its heading, is not longer than before, and other joints keep theirs."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        v, heading = rng.normal(size=10), rng.uniform(-6.0, 6.0)
        feasible = without_slip(v, heading, (0, 1, 2))
        assert abs(lateral_slip(np.array([heading]), feasible[None], (0, 1, 2))[0]) < 1e-15
        assert np.linalg.norm(feasible[:2]) <= np.linalg.norm(v[:2]) + 1e-15
        np.testing.assert_array_equal(feasible[2:], v[2:])
        np.testing.assert_allclose(without_slip(feasible, heading, (0, 1, 2)), feasible, atol=1e-15)


def test_arc_ends_where_the_chord_does():
    """Held over a period while it turns, a command along the middle heading ends within v T (ω T)²/12 of it."""
    v, w, T = 0.4, 0.6, 0.1
    middle = 0.5 * w * T
    command = np.array([v * np.cos(middle), v * np.sin(middle), w])
    steps = 1000
    position = np.zeros(2)
    for k in range(steps):
        heading = w * T * (k + 0.5) / steps
        position += T / steps * without_slip(command, heading, (0, 1, 2))[:2]
    assert np.linalg.norm(position - T * command[:2]) < 1.01 * v * T * (w * T) ** 2 / 12.0


def test_platform_twist_ports(omnirob):
    """The system publishes the law of its inputs."""
    system = PlatformTwist(omnirob, BASE)
    context = system.CreateDefaultContext()
    q, v = omnirob.home.copy(), np.arange(10.0)
    q[2] = 0.7
    system.GetInputPort("position_measured").FixValue(context, q)
    system.GetInputPort("velocity_commanded").FixValue(context, v)
    np.testing.assert_array_equal(
        system.GetOutputPort("velocity_feasible").Eval(context), without_slip(v, 0.7, (0, 1, 2))
    )


@pytest.mark.parametrize("kind", [PlatformTwist, lambda robot, base: Wheels(robot, base, STEP)])
def test_bad_base_is_named(omnirob, kind):
    """A platform has three joints, and they must exist."""
    with pytest.raises(ParameterError, match="x, y and theta"):
        kind(omnirob, ("px", "py"))
    with pytest.raises(UnknownNameError, match="no joint 'pw'"):
        kind(omnirob, ("px", "py", "pw"))


def test_wheels_do_no_work_along_the_heading(omnirob):
    """Their force is lateral and acts on the platform's translation alone; at rest with no torque it is zero."""
    rng = np.random.default_rng(1)
    q = omnirob.home.copy()
    q[2] = 0.8
    torque = evaluate_dynamics(omnirob, q, np.zeros(10)).g
    np.testing.assert_allclose(wheel_force(omnirob, q, np.zeros(10), torque, (0, 1, 2), STEP), 0.0, atol=1e-9)
    v = 0.3 * rng.normal(size=10)
    force = wheel_force(omnirob, q, v, torque + rng.normal(size=10), (0, 1, 2), STEP)
    assert abs(force[0] * np.cos(q[2]) + force[1] * np.sin(q[2])) < 1e-9
    np.testing.assert_array_equal(force[2:], 0.0)


def test_simulated_platform_does_not_slip(omnirob):
    """Pushed sideways by 300 N while it turns, the simulated plant's platform rolls along its heading at every step."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(STEP))
    omnirob.add_to(plant)
    plant.Finalize()
    torque = evaluate_dynamics(omnirob, omnirob.home, np.zeros(10)).g
    torque[:3] = [150.0, 300.0, 20.0]
    source = builder.AddSystem(ConstantVectorSource(torque))
    wheels = builder.AddSystem(Wheels(omnirob, BASE, STEP))
    builder.Connect(plant.get_state_output_port(), wheels.GetInputPort("state"))
    builder.Connect(source.get_output_port(), wheels.GetInputPort("torque"))
    builder.Connect(source.get_output_port(), plant.get_actuation_input_port())
    builder.Connect(wheels.get_output_port(), plant.get_applied_generalized_force_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, omnirob.home)
    slip = []
    for k in range(400):
        simulator.AdvanceTo(STEP * (k + 1))
        state = plant.get_state_output_port().Eval(context)
        slip.append(lateral_slip(state[2:3], state[None, 10:], (0, 1, 2))[0])
    assert np.hypot(state[10], state[11]) > 0.1 and state[2] > 0.02  # it has moved and turned
    assert np.abs(slip).max() < 1e-9
