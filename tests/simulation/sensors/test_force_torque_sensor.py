"""The wrist sensor on a plant: known loads, the tool's weight in all postures, taring, identification."""

import numpy as np
import pytest
from arms import INERTIAL
from bench import Bench
from pydrake.common.value import AbstractValue
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.control.joint_servo import JointVelocityServo
from saphari_drake.errors import ParameterError, StateError, UnknownNameError
from saphari_drake.perception.wrench.tool import ToolParameters, identify_tool, tool_wrench
from saphari_drake.robots.catalog import models_dir
from saphari_drake.robots.dynamics import RobotDynamics, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensor, ForceTorqueSensorParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell

G = np.array([0.0, 0.0, -9.81])
EXACT = {"noise_force": 0.0, "noise_torque": 0.0, "bias_force": 0.0, "bias_torque": 0.0, "tare_samples": 0}
AT_WELD = {"joint": "flange", "tip_frame": "tool", "tip_point": [0.0, 0.0, 0.1]}
TOOL = (
    f'<link name="tool">{INERTIAL.format(com="0.01 -0.02 0.06", mass=0.8, i=0.002)}</link>'
    '<joint name="flange" type="fixed"><parent link="link_7"/><child link="tool"/>'
    '<origin xyz="0 0 0.01" rpy="0 0 0.5"/></joint></robot>'
)
POSTURES = [
    np.deg2rad([0.0, -30.0, 0.0, 83.7, 0.0, 23.7, 0.0]),
    np.deg2rad([40.0, 50.0, -60.0, -70.0, 30.0, 80.0, -50.0]),
    np.deg2rad([-80.0, -20.0, 100.0, 90.0, -120.0, -60.0, 70.0]),
    np.deg2rad([10.0, 60.0, 20.0, 30.0, 60.0, -90.0, 120.0]),
    np.deg2rad([120.0, 10.0, -30.0, -100.0, 90.0, 50.0, 10.0]),
]


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """The LWR4 with a tool of 0.8 kg welded to its flange."""
    path = tmp_path_factory.mktemp("tool") / "lwr4_tool.urdf"
    path.write_text((models_dir() / "lwr4" / "lwr4.urdf").read_text().replace("</robot>", TOOL))
    return RobotModel(path, home=POSTURES[0])


class Rig:
    """The arm held still by a servo, with the sensor in its wrist and a force on its tool."""

    def __init__(self, robot, **params):
        builder = DiagramBuilder()
        self.cell = add_cell(builder, robot)
        plant = self.cell.plant
        params = ForceTorqueSensorParameters(**{**AT_WELD, **params})
        self.sensor = builder.AddSystem(ForceTorqueSensor(robot, plant, self.cell.instance, params))
        joints = builder.AddSystem(JointSensor(robot, JointSensorParameters(0.001, 0.0, 0.0, False)))
        dynamics, servo = builder.AddSystem(RobotDynamics(robot)), builder.AddSystem(JointVelocityServo(robot))
        rest = builder.AddSystem(ConstantVectorSource(np.zeros(robot.n)))
        builder.Connect(self.cell.robot_state, joints.GetInputPort("state"))
        for name in ("position_measured", "velocity_measured"):
            builder.Connect(joints.GetOutputPort(name), dynamics.GetInputPort(name))
        builder.Connect(dynamics.get_output_port(), servo.GetInputPort("dynamics"))
        builder.Connect(dynamics.get_output_port(), self.sensor.GetInputPort("dynamics"))
        builder.Connect(rest.get_output_port(), servo.GetInputPort("velocity_commanded"))
        builder.Connect(servo.GetOutputPort("torque_commanded"), self.cell.torque_input)
        builder.Connect(plant.get_reaction_forces_output_port(), self.sensor.GetInputPort("reaction_forces"))
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.own = self.sensor.GetMyMutableContextFromRoot(self.context)
        self.plant_context = plant.GetMyMutableContextFromRoot(self.context)

    def hold(self, q, f_W=(0.0, 0.0, 0.0), point=(0.0, 0.0, 0.1), seconds=0.02, lock=True):
        """Hold a posture under a force at a point of the tool, the joints locked."""
        plant = self.cell.plant
        force = ExternallyAppliedSpatialForce()
        force.body_index = plant.GetBodyByName("tool").index()
        force.p_BoBq_B, force.F_Bq_W = point, SpatialForce(np.zeros(3), f_W)
        plant.get_applied_spatial_force_input_port().FixValue(self.plant_context, AbstractValue.Make([force]))
        plant.SetPositions(self.plant_context, self.cell.instance, q)
        plant.SetVelocities(self.plant_context, self.cell.instance, np.zeros(7))
        for name in self.cell.robot.joint_names if lock else ():
            plant.GetJointByName(name, self.cell.instance).Lock(self.plant_context)
        self.simulator.AdvanceTo(self.context.get_time() + seconds)

    def read(self, name="wrench_measured"):
        return np.array(self.sensor.GetOutputPort(name).Eval(self.own))


@pytest.fixture(scope="module")
def exact(robot):
    return Rig(robot, **EXACT)


@pytest.mark.parametrize("q", POSTURES)
def test_nothing_is_read_while_nobody_touches_in_any_posture(exact, q):
    """The tool's weight, 7.85 N, is taken out within 0.05 N and 0.005 Nm."""
    exact.hold(q)
    assert np.linalg.norm(exact.read()[3:]) < 0.05
    assert np.linalg.norm(exact.read()[:3]) < 0.005


@pytest.mark.parametrize("q", POSTURES[:3])
def test_a_known_force_is_read_with_its_sign_and_moment(exact, q):
    """The force on the robot, not of it: within 0.05 N; its moment about the tip follows from its lever arm."""
    f_W = np.array([4.0, -12.0, 7.0])
    exact.hold(q, f_W)
    np.testing.assert_allclose(exact.read(), [0.0, 0.0, 0.0, *f_W], atol=0.05)
    beside = np.array([0.03, 0.0, 0.1])
    exact.hold(q, f_W, beside)
    plant = exact.cell.plant
    R_WT = plant.GetBodyByName("tool").EvalPoseInWorld(exact.plant_context).rotation().matrix()
    np.testing.assert_allclose(exact.read()[3:], f_W, atol=0.05)
    np.testing.assert_allclose(exact.read()[:3], np.cross(R_WT @ [0.03, 0.0, 0.0], f_W), atol=0.005)


def test_a_hung_load_is_weighed(exact):
    """One kilogram more on the hook pulls with 9.81 N straight down."""
    exact.hold(POSTURES[1], 1.0 * G)
    np.testing.assert_allclose(exact.read()[3:], 1.0 * G, atol=0.05)


def test_in_the_sensor_frame_it_is_the_same_wrench(exact):
    f_W = np.array([4.0, -12.0, 7.0])
    exact.hold(POSTURES[1], f_W)
    X_WS = exact.cell.plant.GetBodyByName("tool").EvalPoseInWorld(exact.plant_context)
    wrench = exact.read("wrench_sensor")
    np.testing.assert_allclose(X_WS.rotation().matrix() @ wrench[3:], f_W, atol=0.05)
    np.testing.assert_allclose(wrench[:3], np.cross([0.0, 0.0, 0.1], wrench[3:]), atol=0.005)


def test_without_a_weld_the_last_joint_is_the_sensor(lwr4):
    """Then the last link is the tool, and it is read as it is in the plant."""
    builder = DiagramBuilder()
    cell = add_cell(builder, lwr4)
    sensor = ForceTorqueSensor(lwr4, cell.plant, cell.instance)
    assert sensor.tool.mass == pytest.approx(0.311125)
    np.testing.assert_allclose(sensor.tool.com, [-0.000962, 0.00309, -0.017256], atol=1e-9)


def test_taring_takes_the_bias_out(robot):
    """A bias of newtons is gone after the first samples, up to the noise's mean; nothing is told meanwhile."""
    rig = Rig(robot, bias_force=3.0, bias_torque=0.1, noise_force=0.05, noise_torque=0.001, tare_samples=100)
    rig.hold(POSTURES[0], seconds=0.05)
    np.testing.assert_array_equal(rig.read(), 0.0)
    rig.hold(POSTURES[0], seconds=0.06)
    np.testing.assert_allclose(rig.read()[3:], 0.0, atol=0.25)
    rig.hold(POSTURES[2], [0.0, 10.0, 0.0], seconds=0.02)
    np.testing.assert_allclose(rig.read()[3:], [0.0, 10.0, 0.0], atol=0.25)
    rig.sensor.tare(rig.own)
    rig.hold(POSTURES[2], [0.0, 10.0, 0.0], seconds=0.11)
    np.testing.assert_allclose(rig.read()[3:], 0.0, atol=0.25)


def test_a_moving_tool_is_read_without_its_inertia(robot):
    """Shaken at several m/s²: with accelerations the error falls to a fraction of m a."""
    rig = Rig(robot, **EXACT)
    rig.sensor.GetInputPort("acceleration_measured").FixValue(rig.own, np.zeros(7))
    plant = rig.cell.plant
    rig.hold(POSTURES[1], [0.0, 0.0, 0.0], seconds=0.003, lock=False)
    plant.SetVelocities(rig.plant_context, rig.cell.instance, [1.0, -0.8, 0.5, 1.0, -0.6, 0.8, 1.2])
    rig.simulator.AdvanceTo(rig.context.get_time() + 0.001)
    before = np.array(plant.GetVelocities(rig.plant_context, rig.cell.instance))
    rig.simulator.AdvanceTo(rig.context.get_time() + 2e-5)  # one step, and the sample of it
    after = np.array(plant.GetVelocities(rig.plant_context, rig.cell.instance))
    uncorrected = rig.read()
    rig.sensor.GetInputPort("acceleration_measured").FixValue(rig.own, (after - before) / 0.001)
    corrected = rig.read()
    assert np.linalg.norm(uncorrected[3:]) > 20.0
    assert np.linalg.norm(corrected[3:]) < 0.1 * np.linalg.norm(uncorrected[3:])


def test_overload_is_told_and_cut(robot):
    rig = Rig(robot, **{**EXACT, "range_force": 20.0})
    rig.hold(POSTURES[0], [0.0, 100.0, 0.0])
    assert rig.read("overload") == [1.0]
    assert np.isfinite(rig.read()).all()
    rig.hold(POSTURES[0])
    assert rig.read("overload") == [0.0]


def test_noise_is_reproduced_by_a_clone_and_of_the_stated_size(robot):
    cell = add_cell(DiagramBuilder(), robot)
    params = ForceTorqueSensorParameters(**AT_WELD, noise_force=0.1, tare_samples=0, bias_force=0.0)
    sensor = ForceTorqueSensor(robot, cell.plant, cell.instance, params)
    count = cell.plant.num_joints()
    terms = evaluate_dynamics(robot, robot.home, np.zeros(7))
    bench = Bench(sensor, reaction_forces=[SpatialForce(np.ones(3), np.ones(3))] * count, dynamics=terms)
    clone, readings = bench.clone(), []
    for k in range(200):
        bench.run(1)
        readings.append(bench.read("wrench_sensor")[3:])
        if k < 20:
            clone.run(1)
            np.testing.assert_array_equal(clone.read("wrench_sensor"), bench.read("wrench_sensor"))
    assert np.std(readings, axis=0).mean() == pytest.approx(0.1, rel=0.15)


def test_a_tool_is_identified_from_postures(robot, exact):
    """Mass, centre of mass and bias come out of readings of the plant at rest; with noise, within its means."""
    plant, bias = exact.cell.plant, np.array([0.02, -0.03, 0.01, 1.0, -2.0, 0.5])
    orientations, readings = [], []
    for q in POSTURES:
        exact.hold(q)
        R_WS = plant.GetBodyByName("tool").EvalPoseInWorld(exact.plant_context).rotation().matrix()
        orientations.append(R_WS)
        readings.append(exact.read("wrench_sensor") + tool_wrench(exact.sensor.tool, R_WS, G) + bias)
    found = identify_tool(np.array(orientations), np.array(readings), G)
    assert found.tool.mass == pytest.approx(0.8, abs=0.005)
    np.testing.assert_allclose(found.tool.com, [0.01, -0.02, 0.06], atol=5e-4)
    np.testing.assert_allclose(found.bias, bias, atol=0.03)
    assert found.residual_force < 0.03


def test_identification_of_many_noisy_postures():
    rng = np.random.default_rng(0)
    tool, bias = ToolParameters(1.2, [0.01, 0.02, 0.07]), np.array([0.1, 0.0, -0.1, 3.0, -1.0, 2.0])
    R_WS = np.array([RollPitchYaw(*rng.uniform(-3.0, 3.0, 3)).ToRotationMatrix().matrix() for _ in range(60)])
    noise = rng.normal(size=(60, 6)) * [0.002, 0.002, 0.002, 0.05, 0.05, 0.05]
    found = identify_tool(R_WS, np.array([tool_wrench(tool, R, G) for R in R_WS]) + bias + noise, G)
    assert found.tool.mass == pytest.approx(1.2, abs=0.005)
    np.testing.assert_allclose(found.tool.com, tool.com, atol=2e-4)
    np.testing.assert_allclose(found.bias, bias, atol=0.03)
    assert found.residual_force == pytest.approx(0.05, rel=0.2)


def test_postures_that_do_not_tell_are_refused():
    """Turning about the vertical alone leaves weight and bias mixed."""
    upright = np.array([RotationMatrix.MakeZRotation(a).matrix() for a in np.linspace(0.0, 6.0, 8)])
    with pytest.raises(StateError, match="cannot be told apart"):
        identify_tool(upright, np.ones((8, 6)), G)
    with pytest.raises(StateError, match="do not go with"):
        identify_tool(upright, np.ones((7, 6)), G)
    with pytest.raises(StateError, match="not finite"):
        identify_tool(upright, np.full((8, 6), np.nan), G)


def test_bad_names_and_parameters_are_told(robot):
    cell = add_cell(DiagramBuilder(), robot)
    for change, error, match in (
        ({"joint": "wrist"}, UnknownNameError, "flange"),
        ({"tip_frame": "link_5"}, ParameterError, "does not move with"),
        ({"tip_frame": "hook"}, UnknownNameError, "tool"),
    ):
        params = ForceTorqueSensorParameters(**{**AT_WELD, **change})
        with pytest.raises(error, match=match):
            ForceTorqueSensor(robot, cell.plant, cell.instance, params)
    for name in ("period", "noise_force", "bias_torque", "range_force", "tare_samples"):
        with pytest.raises(ParameterError, match=name):
            ForceTorqueSensorParameters(**{name: -1})
    with pytest.raises(ParameterError, match="mass"):
        ToolParameters(mass=-1.0)
    with pytest.raises(ParameterError, match="com"):
        ToolParameters(com=[0.0, np.nan, 0.0])
