"""The force of wheels that cannot slip sideways on the simulated plant."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.world.wheels import Wheels, lateral_slip, wheel_force

BASE = ("px", "py", "pz")
STEP = 0.001


@pytest.fixture(scope="module")
def omnirob():
    return catalog.omnirob()


def test_bad_base_is_named(omnirob):
    """A platform has three joints, and they must exist."""
    with pytest.raises(ParameterError, match="x, y and theta"):
        Wheels(omnirob, ("px", "py"), STEP)
    with pytest.raises(UnknownNameError, match="no joint 'pw'"):
        Wheels(omnirob, ("px", "py", "pw"), STEP)


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
