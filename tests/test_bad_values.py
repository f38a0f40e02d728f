"""Values that fit a port's type and nothing else: each system says so, and none reads what is not there."""

import numpy as np
import pytest
from bench import Bench
from experiments.nmpc.manipulator import ManipulatorParameters

from saphari_drake import RobotCorrections, evaluate_dynamics, planar_6r
from saphari_drake.control import (
    ContactForceController,
    ContactImpedanceController,
    HandGuidingController,
    HandGuidingParameters,
    JointVelocityServo,
    NmpcController,
    NullSpaceComplianceController,
    ReversePriorityController,
)
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, NmpcStatus, TestPoint
from saphari_drake.control.reverse_priority.law import PriorityStatus
from saphari_drake.control.reverse_priority.stack import PriorityStack
from saphari_drake.control.reverse_priority.tasks import Component, Kind, ScalarTask, pose_task, position_task
from saphari_drake.errors import ParameterError, StateError
from saphari_drake.estimation import ContactForceEstimator, MomentumObserver
from saphari_drake.math.rotations import are_rotations, rotation_exp
from saphari_drake.messages import (
    ContactPoint,
    Interaction,
    InteractionMode,
    ObstaclePoints,
    SkinContact,
    SkinReading,
    SystemStatus,
)
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.wrench.estimator import WristWrenchEstimator
from saphari_drake.pipelines import HandGuidingPipelineParameters
from saphari_drake.safety import CommandSwitch, ContactMonitor, VerifiedStop
from saphari_drake.safety.verified_stop.law import StopStatus
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.people.recorded_push import RecordedPushParameters
from saphari_drake.simulation.world.plant import PlantParameters
from saphari_drake.systems import cycle

NAN, ZERO = np.full(3, np.nan), np.zeros(3)
BAD_POINTS = {
    "link 7 of 7": ContactPoint(True, 7, ZERO),
    "link 99": ContactPoint(True, 99, ZERO),
    "link -1": ContactPoint(True, -1, ZERO),
    "link 2.5": ContactPoint(True, 2.5, ZERO),
    "two numbers": ContactPoint(True, 6, np.zeros(2)),
    "no number": ContactPoint(True, 6, np.zeros(0)),
    "not finite": ContactPoint(True, 6, NAN),
}
ONE = np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1)
BAD_OBSTACLES = {
    "stamp": ObstaclePoints(*ONE, stamp=np.nan),
    "two coordinates": ObstaclePoints(np.zeros((1, 2)), *ONE[1:], stamp=0.0),
    "velocities": ObstaclePoints(ONE[0], np.zeros((2, 3)), ONE[2], stamp=0.0),
    "radii": ObstaclePoints(*ONE[:2], np.zeros(0), stamp=0.0),
    "radius": ObstaclePoints(*ONE[:2], np.array([-1.0]), stamp=0.0),
    "not finite": ObstaclePoints(np.full((1, 3), np.nan), *ONE[1:], stamp=0.0),
}


@pytest.fixture(scope="module")
def terms(lwr4):
    return evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))


@pytest.fixture(scope="module")
def nmpc(lwr4):
    return NmpcController(lwr4, "link_7", [TestPoint("tip", "link_7", d_min=0.1)], NmpcParameters(period=0.005))


# ---- links and points ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("link", [-1, 7, 99, 2.0, "link_1", None])
def test_a_link_that_is_none_raises(terms, link):
    """Where a compiled law would read what lies behind the arrays."""
    for ask in (terms.point, terms.position, terms.in_link):
        with pytest.raises(StateError, match=r"link: there are 0 … 6, got"):
            ask(link, ZERO)
    assert np.isfinite(terms.point(np.int64(6), ZERO).Jv_WC).all()


@pytest.mark.parametrize("point", [np.zeros(2), np.zeros(4), np.zeros((3, 1)), 0.0])
def test_a_point_of_another_size_raises(terms, point):
    for ask in (terms.point, terms.position, terms.in_link):
        with pytest.raises(StateError, match="point: needs three numbers"):
            ask(6, point)


@pytest.mark.parametrize("point", BAD_POINTS.values(), ids=BAD_POINTS)
def test_a_contact_on_no_link_is_told(lwr4, terms, point):
    """Force and torque are not known; the monitor yields, as to a touch that nobody sees."""
    zero = np.zeros(7)
    force = Bench(ContactForceEstimator(lwr4), dynamics=terms, torque_external=zero + 1.0, contact_point=point)
    assert np.isnan(force.read("contact_force")).all() and force.read("system_status") == SystemStatus.BAD_INPUT
    now = Interaction(InteractionMode.CONTACT, point, lwr4.home, 1)
    for kind in (ContactImpedanceController, ContactForceController):
        inputs = {"dynamics": terms, "interaction": now, "contact_force": ZERO, "misfit": zero}
        controller = kind(lwr4)
        more = {"unobservable_directions": np.zeros(9), "transition_left": zero}
        more = {name: value for name, value in more.items() if controller.HasInputPort(name)}
        told = Bench(controller, **inputs, **more)
        assert np.isnan(told.read("torque_commanded")).all() and told.read("system_status") == SystemStatus.BAD_INPUT
    monitor = Bench(ContactMonitor(lwr4), dynamics=terms, contact=1.0, contact_point=point, camera_status=1.0)
    assert monitor.read("system_status") == SystemStatus.BAD_INPUT
    monitor.run(3)
    assert monitor.read("mode") == InteractionMode.YIELD


@pytest.mark.parametrize("point", BAD_POINTS.values(), ids=BAD_POINTS)
def test_a_skin_contact_on_no_link_is_told(lwr4, terms, point):
    contact = SkinContact(point.link, point.p_LC, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -5.0]))
    reading = SkinReading((contact,), stamp=0.0)
    guiding = Bench(HandGuidingController(lwr4), dynamics=terms, skin=reading, wrench_measured=np.zeros(6))
    assert guiding.read("system_status") == SystemStatus.BAD_INPUT
    guiding.set(skin=SkinReading(stamp=0.0))
    assert guiding.read("system_status") == SystemStatus.OK
    guiding.set(skin=SkinReading(stamp=np.nan))
    assert guiding.read("system_status") == SystemStatus.BAD_INPUT


# ---- dynamics of another arm ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "kind",
    [
        CommandSwitch, ContactForceEstimator, ContactImpedanceController, ContactMonitor, HandGuidingController,
        JointVelocityServo, MomentumObserver, NullSpaceComplianceController, WristWrenchEstimator,
    ],
)  # fmt: skip
def test_the_dynamics_of_another_arm_are_not_known(lwr4, terms, kind):
    """Of six joints and of ten; the system says what it says to a state that is not finite, and works again."""
    system = kind(lwr4)
    told = []
    other = evaluate_dynamics(planar_6r(), planar_6r().home, np.zeros(6))
    for given in (terms.unknown(), other, terms):
        bench = Bench(system, dynamics=given)
        for i in range(system.num_input_ports()):
            port = system.get_input_port(i)
            if port.get_name() != "dynamics" and port.size() > 0:
                port.FixValue(bench.context, np.zeros(port.size()))
        for name, value in (("skin", SkinReading(stamp=0.0)), ("contact_point", ContactPoint())):
            if system.HasInputPort(name):
                bench.set(**{name: value})
        if system.HasInputPort("interaction"):
            bench.set(interaction=Interaction(InteractionMode.HOLD, ContactPoint(), lwr4.home, 0))
        if system.HasInputPort("selection"):
            continue
        bench.run()
        names = [system.get_output_port(i).get_name() for i in range(system.num_output_ports())]
        told.append([bench.read(name) for name in names if "status" in name])
    if told:
        assert told[0] == told[1]
        assert kind is WristWrenchEstimator or told[1] != told[2]  # it takes its bias first


# ---- obstacles and references --------------------------------------------------------------------------------------


@pytest.mark.parametrize("points", BAD_OBSTACLES.values(), ids=BAD_OBSTACLES)
def test_obstacles_that_cannot_be_used_stop_the_robot(lwr4, nmpc, points):
    assert not points.usable or points.age(0.0) == np.inf
    bench = Bench(nmpc, position_measured=lwr4.home, obstacles=points)
    assert bench.read("status") in (NmpcStatus.BAD_INPUT, NmpcStatus.OBSTACLES_LOST)
    np.testing.assert_array_equal(bench.read("velocity_commanded"), np.zeros(7))
    for port in ("people", "things"):
        stop = Bench(VerifiedStop(lwr4), position_measured=lwr4.home, velocity_commanded=0.1 * lwr4.v_max)
        stop.run(1, **{port: points})
        assert stop.read("status") == StopStatus.OBSTACLES_LOST
        np.testing.assert_array_equal(stop.read("velocity_applied"), np.zeros(7))


def test_obstacles_without_a_stamp_hold_at_all_times(lwr4, nmpc):
    """Those with one are lost once they are too old."""
    far = np.full((1, 3), 3.0), np.zeros((1, 3)), np.zeros(1)
    still, seen = ObstaclePoints(*far), ObstaclePoints(*far, stamp=0.0)
    for points, status in ((still, NmpcStatus.SOLVED), (seen, NmpcStatus.OBSTACLES_LOST)):
        bench = Bench(nmpc, position_measured=lwr4.home, obstacles=points)
        bench.run(130)
        assert bench.read("status") == status
    stop = Bench(VerifiedStop(lwr4), position_measured=lwr4.home, velocity_commanded=0.0 * lwr4.v_max, things=still)
    stop.run(130)
    assert stop.read("status") == StopStatus.PASSING


@pytest.mark.parametrize("R", [np.zeros((3, 3)), 2.0 * np.eye(3), np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan)])
def test_what_is_no_rotation_is_told(lwr4, nmpc, R):
    assert not are_rotations(R[None]) and are_rotations(rotation_exp(np.array([0.3, 2.0, -1.0]))[None])
    reference = NmpcReference(np.array([[0.4, 0.0, 0.5]]), R[None])
    bench = Bench(nmpc, position_measured=lwr4.home, reference=reference)
    assert bench.read("status") == NmpcStatus.BAD_INPUT
    np.testing.assert_array_equal(bench.read("velocity_commanded"), np.zeros(7))
    priority = Bench(ReversePriorityController(lwr4, [pose_task(lwr4, "link_7")]), position_measured=lwr4.home)
    assert priority.read("status") == PriorityStatus.OK
    priority.set(references=np.concatenate([R.ravel(), np.zeros(9)]))
    assert priority.read("status") == PriorityStatus.INVALID
    np.testing.assert_array_equal(priority.read("velocity_commanded"), np.zeros(7))


# ---- constructors --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "component",
    [
        Component("x", Kind.PLANE, "m", link=7),
        Component("x", Kind.JOINT, "rad", index=7),
        Component("x", Kind.TURN, "", index=3),
    ],
)
def test_components_that_the_robot_does_not_have(lwr4, component):
    with pytest.raises(ParameterError, match=r"levels: .* has no link \d|levels: .* has no link -1, or no"):
        PriorityStack(lwr4, [ScalarTask(component)])


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: NmpcParameters(horizon=100000), "horizon: must lie in 1 … 1000"),
        (lambda: RecordedPushParameters(peak=1e6), "peak: must lie in 0.001 … 1000"),
        (lambda: Push(force=np.nan), "force: must lie in"),
        (lambda: CameraParameters(width=1000000), "width: must lie in 1 … 8192"),
        (lambda: CameraParameters(rate=1e9), "rate: must lie in"),
        (lambda: PlantParameters(time_step=1e-9), "time_step: must lie in"),
        (lambda: cycle(1e-9), "period: must be at least"),
        (lambda: RobotCorrections.read("none.yaml"), "identified: no file 'none.yaml'"),
        (lambda: ManipulatorParameters(obstacles=[[np.nan, 0.0, 0.0]]), "obstacles: needs points of three finite"),
        (lambda: ManipulatorParameters(obstacles=[[0.0, 0.0, 0.0], [0.0]]), "obstacles: needs points of three finite"),
        (
            lambda: HandGuidingPipelineParameters(controller=HandGuidingParameters(period=0.004)),
            "controller.period: is",
        ),
    ],
)
def test_numbers_that_no_run_would_end_with(made, message):
    with pytest.raises(ParameterError, match=message):
        made()


@pytest.mark.parametrize("axes", ["xq", "", "0"])
def test_axes_that_are_none(lwr4, axes):
    with pytest.raises(ParameterError, match="axes: needs some of x, y and z"):
        position_task(lwr4, "link_7", axes)
