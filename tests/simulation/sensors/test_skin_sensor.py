"""The skin in a plant: touched by applied forces and by the hand, felt by the estimator, the same in a clone."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ContactResults, ExternallyAppliedSpatialForce
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import DiagramBuilder
from skin_touches import calibrated

from saphari_drake.errors import ParameterError
from saphari_drake.math.rotations import rotation_between
from saphari_drake.messages import SkinStatus
from saphari_drake.perception.skin.estimator import SkinEstimator
from saphari_drake.perception.skin.layout import SkinLayout
from saphari_drake.simulation.sensors.skin_indenter import IndenterParameters
from saphari_drake.simulation.sensors.skin_modules import SkinModuleParameters
from saphari_drake.simulation.sensors.skin_sensor import SkinSensor, SkinSensorParameters
from saphari_drake.simulation.world.cell import add_cell, contact_truth
from saphari_drake.simulation.world.pushing_hand import PushingHand

QUIET = SkinSensorParameters(noise=0.0, drift=0.0, common_drift=0.0)


@pytest.fixture(scope="module")
def cell(lwr4):
    builder = DiagramBuilder()
    cell = add_cell(builder, lwr4)
    diagram = builder.Build()
    yield cell
    del diagram  # it keeps the plant


@pytest.fixture(scope="module")
def layout(lwr4):
    return SkinLayout(lwr4)


def force_at(cell, p_L, f_W, body="link_3"):
    force = ExternallyAppliedSpatialForce()
    force.body_index = cell.plant.GetBodyByName(body).index()
    force.p_BoBq_B, force.F_Bq_W = p_L, SpatialForce(np.zeros(3), f_W)
    return force


def link_pose(cell, q):
    context = cell.plant.CreateDefaultContext()
    cell.plant.SetPositions(context, cell.instance, q)
    return cell.plant.GetBodyByName("link_3").EvalPoseInWorld(context)


def sensor_at(cell, layout, q, forces, params=QUIET):
    """Return a sensor and a Context with fixed inputs."""
    sensor = SkinSensor(layout, cell.robot, cell.plant, cell.instance, params)
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("state").FixValue(context, np.concatenate([q, np.zeros(7)]))
    sensor.GetInputPort("applied_forces").FixValue(context, AbstractValue.Make(forces))
    return sensor, context


def test_applied_forces_reach_the_modules_whatever_the_posture(cell, layout):
    """Σ R_i F_i equals R_LWᵀ f_W for random postures; forces on other links press nothing."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = cell.robot.home + rng.uniform(-1.0, 1.0, 7)
        R_WL = link_pose(cell, q).rotation().matrix()
        f_L = np.array([1.0, -9.0, 2.0])
        other = force_at(cell, layout.p_LP, [0.0, 0.0, -30.0], "link_5")
        sensor, context = sensor_at(cell, layout, q, [force_at(cell, layout.p_LP, R_WL @ f_L), other])
        (touch,) = sensor.touches(context)
        np.testing.assert_allclose(touch.f_L, f_L, atol=1e-9)
        f_M, _ = sensor.modules.forces([touch])
        np.testing.assert_allclose(np.einsum("mij,mj->i", layout.R_LM, f_M), f_L, atol=1e-9)


def test_what_presses_the_link_elsewhere_is_not_felt(cell, layout):
    off = layout.p_LP + 0.03 * layout.R_LP[:, 2]
    sensor, context = sensor_at(cell, layout, cell.robot.home, [force_at(cell, off, [0.0, -9.0, 0.0])])
    assert sensor.touches(context) == []
    back = layout.p_LP * [1.0, -1.0, 1.0]
    sensor, context = sensor_at(cell, layout, cell.robot.home, [force_at(cell, back, [0.0, 9.0, 0.0])])
    f_M, _ = sensor.modules.forces(sensor.touches(context))
    np.testing.assert_array_equal(f_M, 0.0)


def test_the_hand_of_the_plant_is_felt_as_it_presses(cell, layout, lwr4):
    """Through the contact results: the same force as theirs on the link, at the same point."""
    builder = DiagramBuilder()
    own = add_cell(builder, lwr4, [PushingHand()])
    sensor = builder.AddSystem(SkinSensor(layout, lwr4, own.plant, own.instance, QUIET))
    estimator = builder.AddSystem(SkinEstimator(layout, calibrated(sensor.modules, IndenterParameters(60))))
    builder.Connect(own.robot_state, sensor.GetInputPort("state"))
    builder.Connect(own.plant.get_contact_results_output_port(), sensor.GetInputPort("contact_results"))
    for name in ("voltages", "sample_time"):
        builder.Connect(sensor.GetOutputPort(name), estimator.GetInputPort(name))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    root = simulator.get_mutable_context()
    plant_context = own.plant.GetMyMutableContextFromRoot(root)
    own.torque_input.FixValue(plant_context, np.zeros(7))
    X_WL = link_pose(own, lwr4.home)
    p_L, R_L = layout.surface([0.004, -0.003])
    tip = X_WL @ (p_L + (0.012 - 0.001) * R_L[:, 2])  # 1 mm deep
    turn = rotation_between(np.array([1.0, 0.0, 0.0]), -X_WL.rotation().matrix() @ R_L[:, 2])
    own.plant.SetFreeBodyPose(plant_context, own.plant.GetBodyByName("hand"), RigidTransform(RotationMatrix(turn), tip))
    simulator.AdvanceTo(0.0021)
    results: ContactResults = own.plant.get_contact_results_output_port().Eval(plant_context)
    f_W = contact_truth(results, own)[:3]
    sensor_context = sensor.GetMyContextFromRoot(root)
    (touch,) = sensor.touches(sensor_context)
    R_WL = own.plant.GetBodyByName("link_3").EvalPoseInWorld(plant_context).rotation().matrix()
    np.testing.assert_allclose(R_WL @ touch.f_L, f_W, rtol=1e-6)
    assert touch.f_L @ R_L[:, 2] < -3.0  # the force of the hand on the robot
    (contact,) = estimator.GetOutputPort("skin_reading").Eval(estimator.GetMyContextFromRoot(root)).contacts
    np.testing.assert_allclose(contact.p_LC, p_L, atol=0.002)
    assert contact.normal_force == pytest.approx(-touch.f_L @ R_L[:, 2], rel=0.25)  # sampled up to a period before


def run(cell, layout, params, times=(0.05,), force=-6.0):
    """Return the simulator of a lone sensor under a constant force, run to the last time."""
    forces = [force_at(cell, layout.p_LP, [0.0, force, 0.0])]
    sensor, context = sensor_at(cell, layout, cell.robot.home, forces, params)
    simulator = Simulator(sensor, context)
    simulator.Initialize()
    for time in times:
        simulator.AdvanceTo(time)
    return sensor, simulator


def test_a_cloned_context_reads_the_same_noise_and_drift(cell, layout):
    sensor, simulator = run(cell, layout, SkinSensorParameters(drift=0.01))
    clone = Simulator(sensor, simulator.get_context().Clone())
    clone.Initialize(InitializeParams(suppress_initialization_events=True))
    readings = []
    for each in (simulator, clone):
        each.AdvanceTo(0.1)
        readings.append(sensor.GetOutputPort("voltages").Eval(each.get_context()))
    np.testing.assert_array_equal(*readings)
    other, simulator = run(cell, layout, SkinSensorParameters(drift=0.01, seed=1), (0.1,))
    assert np.any(readings[0] != other.GetOutputPort("voltages").Eval(simulator.get_context()))


def test_noise_and_drift_have_the_stated_size(cell, layout):
    params = SkinSensorParameters(
        noise=0.0, drift=0.004, common_drift=0.0, modules=SkinModuleParameters(resolution=0.0)
    )
    sensor, simulator = run(cell, layout, params, (1.0,), 0.0)
    voltages = sensor.GetOutputPort("voltages").Eval(simulator.get_context())
    assert np.std(voltages - sensor.modules.offset.ravel()) == pytest.approx(0.004, rel=0.2)
    params = SkinSensorParameters(noise=0.003, drift=0.0, common_drift=0.0)
    sensor, simulator = run(cell, layout, params, (0.01,), 0.0)
    voltages = sensor.GetOutputPort("voltages").Eval(simulator.get_context())
    assert np.std(voltages - sensor.modules.offset.ravel()) == pytest.approx(0.003, rel=0.2)


def test_samples_are_held_and_stamped(cell, layout):
    sensor, simulator = run(cell, layout, SkinSensorParameters(), (0.0101,))
    time = sensor.GetOutputPort("sample_time").Eval(simulator.get_context())
    assert time[0] == pytest.approx(0.010, abs=2e-6)
    before = sensor.GetOutputPort("voltages").Eval(simulator.get_context())
    simulator.AdvanceTo(0.0119)
    np.testing.assert_array_equal(sensor.GetOutputPort("voltages").Eval(simulator.get_context()), before)
    simulator.AdvanceTo(0.0121)
    assert np.any(sensor.GetOutputPort("voltages").Eval(simulator.get_context()) != before)


def test_modules_that_die_at_run_time_are_named(cell, layout):
    params = SkinSensorParameters(modules=SkinModuleParameters(dead=[8, 15]), dead_time=0.03)
    sensor, simulator = run(cell, layout, params, (0.02,))
    law = SkinEstimator(layout, calibrated(sensor.modules, IndenterParameters(60))).law
    assert law.start().reading.dead == (8, 15)  # calibrated after their death
    params = replace(params, modules=SkinModuleParameters())
    alive = SkinSensor(layout, cell.robot, cell.plant, cell.instance, params)
    law = SkinEstimator(layout, calibrated(alive.modules, IndenterParameters(60))).law
    memory = law.start()
    for time in (0.02, 0.04):
        simulator.AdvanceTo(time + 1e-4)
        voltages = sensor.GetOutputPort("voltages").Eval(simulator.get_context()).reshape(-1, 4)
        memory = law.sample(memory, voltages, time)
        if time < 0.03:
            assert (memory.reading.status, memory.reading.dead) == (SkinStatus.OK, ())
    assert (memory.reading.status, memory.reading.dead) == (SkinStatus.DEGRADED, (8, 15))


@pytest.mark.parametrize("field", ["period", "noise", "contact_radius", "drift", "dead_time"])
def test_bad_parameters_are_named(field):
    with pytest.raises(ParameterError, match=field):
        SkinSensorParameters(**{field: -1.0})
