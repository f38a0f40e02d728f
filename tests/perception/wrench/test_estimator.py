"""The wrench at the wrist of a simulated arm: known loads, the tool's weight in all postures, taring, faults."""

import numpy as np
import pytest
from arms import INERTIAL
from bench import PERIOD, Bench
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from saphari_drake.control.joint_servo import JointVelocityServo
from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.perception.wrench.estimator import WrenchStatus, WristWrenchEstimator, WristWrenchParameters
from saphari_drake.perception.wrench.tool import ToolParameters, tool_wrench
from saphari_drake.robots.catalog import models_dir
from saphari_drake.robots.dynamics import RobotDynamics, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.sensors.force_torque_sensor import ForceTorqueSensor, ForceTorqueSensorParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.world.cell import add_cell

G = np.array([0.0, 0.0, -9.81])
EXACT = {"noise_force": 0.0, "noise_torque": 0.0, "bias_force": 0.0, "bias_torque": 0.0}
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

    def __init__(self, robot, tare_samples=0, **params):
        builder = DiagramBuilder()
        self.cell = add_cell(builder, robot)
        plant = self.cell.plant
        params = ForceTorqueSensorParameters(joint="flange", **params)
        self.sensor = builder.AddSystem(ForceTorqueSensor(plant, self.cell.instance, params))
        own = WristWrenchParameters(**AT_WELD, period=params.period, tare_samples=tare_samples)
        self.wrist = builder.AddSystem(WristWrenchEstimator(robot, own))
        builder.Connect(self.sensor.GetOutputPort("wrench_sensor"), self.wrist.GetInputPort("wrench_sensor"))
        joints = builder.AddSystem(JointSensor(robot, JointSensorParameters(0.001, 0.0, 0.0, False)))
        dynamics, servo = builder.AddSystem(RobotDynamics(robot)), builder.AddSystem(JointVelocityServo(robot))
        rest = builder.AddSystem(ConstantVectorSource(np.zeros(robot.n)))
        builder.Connect(self.cell.robot_state, joints.GetInputPort("state"))
        for name in ("position_measured", "velocity_measured"):
            builder.Connect(joints.GetOutputPort(name), dynamics.GetInputPort(name))
        builder.Connect(dynamics.get_output_port(), servo.GetInputPort("dynamics"))
        builder.Connect(dynamics.get_output_port(), self.wrist.GetInputPort("dynamics"))
        builder.Connect(rest.get_output_port(), servo.GetInputPort("velocity_commanded"))
        builder.Connect(servo.GetOutputPort("torque_commanded"), self.cell.torque_input)
        builder.Connect(plant.get_reaction_forces_output_port(), self.sensor.GetInputPort("reaction_forces"))
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()
        self.own = self.wrist.GetMyMutableContextFromRoot(self.context)
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
        return np.array(self.wrist.GetOutputPort(name).Eval(self.own))


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
    wrench = exact.read("wrench_tool")
    np.testing.assert_allclose(X_WS.rotation().matrix() @ wrench[3:], f_W, atol=0.05)
    np.testing.assert_allclose(wrench[:3], np.cross([0.0, 0.0, 0.1], wrench[3:]), atol=0.005)


def test_without_a_weld_the_last_joint_is_the_sensor(lwr4):
    """Then the last link is the tool, as the model has it."""
    tool = WristWrenchEstimator(lwr4).tool
    assert tool.mass == pytest.approx(0.311125)
    np.testing.assert_allclose(tool.com, [-0.000962, 0.00309, -0.017256], atol=1e-9)


def test_taring_takes_the_bias_out(robot):
    """A bias of newtons is gone after the first samples, up to the noise's mean; nothing is told meanwhile."""
    rig = Rig(robot, bias_force=3.0, bias_torque=0.1, noise_force=0.05, noise_torque=0.001, tare_samples=100)
    rig.hold(POSTURES[0], seconds=0.05)
    np.testing.assert_array_equal(rig.read(), 0.0)
    rig.hold(POSTURES[0], seconds=0.06)
    np.testing.assert_allclose(rig.read()[3:], 0.0, atol=0.25)
    rig.hold(POSTURES[2], [0.0, 10.0, 0.0], seconds=0.02)
    np.testing.assert_allclose(rig.read()[3:], [0.0, 10.0, 0.0], atol=0.25)
    rig.wrist.tare(rig.own)
    rig.hold(POSTURES[2], [0.0, 10.0, 0.0], seconds=0.11)
    np.testing.assert_allclose(rig.read()[3:], 0.0, atol=0.25)


def test_a_moving_tool_is_read_without_its_inertia(robot):
    """Shaken at several m/s²: with accelerations the error falls to a fraction of m a."""
    rig = Rig(robot, **EXACT)
    rig.wrist.GetInputPort("acceleration_measured").FixValue(rig.own, np.zeros(7))
    plant = rig.cell.plant
    rig.hold(POSTURES[1], [0.0, 0.0, 0.0], seconds=0.003, lock=False)
    plant.SetVelocities(rig.plant_context, rig.cell.instance, [1.0, -0.8, 0.5, 1.0, -0.6, 0.8, 1.2])
    rig.simulator.AdvanceTo(rig.context.get_time() + 0.001)
    before = np.array(plant.GetVelocities(rig.plant_context, rig.cell.instance))
    rig.simulator.AdvanceTo(rig.context.get_time() + 2e-5)  # one step, and the sample of it
    after = np.array(plant.GetVelocities(rig.plant_context, rig.cell.instance))
    uncorrected = rig.read()
    rig.wrist.GetInputPort("acceleration_measured").FixValue(rig.own, (after - before) / 0.001)
    corrected = rig.read()
    assert np.linalg.norm(uncorrected[3:]) > 20.0
    assert np.linalg.norm(corrected[3:]) < 0.1 * np.linalg.norm(uncorrected[3:])


@pytest.mark.parametrize("lasting", [False, True])
@pytest.mark.parametrize("port", ["wrench_sensor", "dynamics", "acceleration_measured"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_told_and_leaves_nothing_behind(robot, port, lasting, bad):
    """While taring and after it: status and NaN while it lasts, then the wrench and a bias without a trace of it."""
    terms = evaluate_dynamics(robot, POSTURES[0], np.zeros(7))
    broken = {
        "wrench_sensor": np.array([0.0, bad, 0.0, 0.0, 0.0, 0.0]),
        "dynamics": terms.unknown(),
        "acceleration_measured": np.full(7, bad),
    }[port]
    wrist = WristWrenchEstimator(robot, WristWrenchParameters(**AT_WELD, period=PERIOD, tare_samples=4))
    own = tool_wrench(wrist.tool, terms.R_WL[6] @ wrist._R_LS, np.array(robot.tree.gravity))
    good = {"wrench_sensor": own + 1.0, "dynamics": terms, "acceleration_measured": np.zeros(7)}
    bench = Bench(wrist, **good)
    bench.run(2)
    assert bench.read("status") == WrenchStatus.TARING
    np.testing.assert_array_equal(bench.read("wrench_measured"), 0.0)
    bench.run(50 if lasting else 2, **{port: broken})
    assert bench.read("status") == WrenchStatus.BAD_INPUT
    bench.run(2, **good)
    assert bench.read("status") == WrenchStatus.OK
    np.testing.assert_allclose(bench.read("wrench_tool"), 0.0, atol=1e-9)
    bench.run(50 if lasting else 2, **{port: broken})
    assert bench.read("status") == WrenchStatus.BAD_INPUT
    assert np.isnan(bench.read("wrench_measured")).all()
    bench.run(1, **{**good, "wrench_sensor": own + 3.0})
    np.testing.assert_allclose(bench.read("wrench_tool"), 2.0, atol=1e-9)


def test_bad_names_and_parameters_are_told(robot):
    for change, error, match in (
        ({"joint": "wrist"}, UnknownNameError, "flange"),
        ({"tip_frame": "link_5"}, ParameterError, "does not move with"),
        ({"tip_frame": "hook"}, UnknownNameError, "tool"),
    ):
        with pytest.raises(error, match=match):
            WristWrenchEstimator(robot, WristWrenchParameters(**{**AT_WELD, **change}))
    for name in ("period", "tare_samples"):
        with pytest.raises(ParameterError, match=name):
            WristWrenchParameters(**{name: -1})
    with pytest.raises(ParameterError, match="mass"):
        ToolParameters(mass=-1.0)
    with pytest.raises(ParameterError, match="com"):
        ToolParameters(com=[0.0, np.nan, 0.0])
