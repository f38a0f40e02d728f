"""The controller as a system: ports, threshold and return, Context clones, bad input."""

import numpy as np
import pytest
from experiments.null_space.cell import NullSpaceCellParameters, add_null_space_cell
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from saphari_drake.control.null_space.law import command_terms, frame_state
from saphari_drake.control.null_space.parameters import OBSERVERS, NullSpaceComplianceParameters
from saphari_drake.control.null_space.system import NullSpaceComplianceController
from saphari_drake.errors import ParameterError, StateError, UnknownNameError
from saphari_drake.messages import SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.record.recorder import Recorder


class Ports:
    """A controller with all its inputs fixed."""

    def __init__(self, robot, **params):
        self.system = NullSpaceComplianceController(robot, NullSpaceComplianceParameters(**params))
        self.context, self.robot = self.system.CreateDefaultContext(), robot
        self.fix(
            q=robot.home, v=np.zeros(robot.n), torque_external=np.zeros(robot.n), torque_external_task=np.zeros(robot.n)
        )

    def fix(self, q=None, v=None, **vectors):
        if q is not None:
            value = AbstractValue.Make(evaluate_dynamics(self.robot, q, v))
            self.system.GetInputPort("dynamics").FixValue(self.context, value)
        for name, value in vectors.items():
            self.system.GetInputPort(name).FixValue(self.context, value)

    def read(self, name, context=None):
        return np.array(self.system.GetOutputPort(name).Eval(context or self.context))

    def run(self, duration, context=None):
        context = context or self.context
        Simulator(self.system, context).AdvanceTo(context.get_time() + duration)


def test_terms_add_up_and_hold_needs_gravity_alone(lwr4):
    """At rest at home the command is gravity; the named terms always sum to the command."""
    ports = Ports(lwr4)
    np.testing.assert_allclose(ports.read("torque_commanded"), evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g)
    rng = np.random.default_rng(1)
    ports.fix(lwr4.home + rng.uniform(-0.2, 0.2, 7), rng.uniform(-1, 1, 7), torque_external=rng.normal(size=7))
    terms = ports.read("torque_terms").reshape(5, 7)
    np.testing.assert_allclose(terms.sum(axis=0), ports.read("torque_commanded"), atol=1e-12)


def test_desired_pose_shows_as_error_and_drives_the_observer(lwr4):
    """In the world, desired minus actual; what a command beyond the limits does is the business of others."""
    ports = Ports(lwr4, observer="task_error")
    p = ports.system.kinematics(evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))).p
    target = AbstractValue.Make(RigidTransform(RotationMatrix(), p + [0.01, 0.0, -0.02]))
    ports.system.GetInputPort("desired_pose").FixValue(ports.context, target)
    np.testing.assert_allclose(ports.read("task_error"), [0.01, 0.0, -0.02], atol=1e-12)
    assert np.any(ports.read("observer_drive") != 0.0)
    ports.fix(torque_external_task=np.full(7, -500.0))
    assert np.any(np.abs(ports.read("torque_commanded")) > lwr4.tau_max)


def test_nothing_compiles_after_construction(lwr4):
    """Whatever is connected, the first control step finds the law compiled."""
    ports = Ports(lwr4, observer="task_error")
    compiled = [len(law.signatures) for law in (command_terms, frame_state)]
    pose = AbstractValue.Make(RigidTransform(RotationMatrix.MakeXRotation(0.1), [0.5, 0.0, 0.5]))
    ports.system.GetInputPort("desired_pose").FixValue(ports.context, pose)
    ports.fix(desired_velocity=np.ones(6), desired_acceleration=np.ones(6), nominal_posture=np.zeros(7))
    ports.run(0.01)
    assert [len(law.signatures) for law in (command_terms, frame_state)] == compiled


@pytest.mark.parametrize("observer", ["none", "momentum"])
def test_task_yields_above_the_threshold_smoothly_and_back(lwr4, observer):
    """Below the threshold nothing; above it the task term fades without a jump, and comes back after the release."""
    ports = Ports(lwr4, observer=observer, torque_threshold=30.0, threshold_band=5.0)
    ports.fix(torque_external=np.eye(7)[1] * 29.0)
    ports.run(0.1)
    assert ports.read("yielding")[0] == 0.0
    ports.fix(torque_external=np.eye(7)[1] * -40.0)
    steps = []
    for _ in range(300):
        steps.append((ports.read("yielding")[0], *ports.read("torque_commanded")))
        ports.run(0.002)
    steps = np.array(steps)
    assert np.all(np.diff(steps[:, 0]) >= 0.0) and steps[-1, 0] > 0.99
    assert np.abs(np.diff(steps, axis=0)).max() < 1.5
    ports.fix(torque_external=np.zeros(7))
    ports.run(2.0)
    assert ports.read("yielding")[0] == 0.0


@pytest.mark.parametrize("observer", OBSERVERS)
def test_task_returns_smoothly_after_yielding(lwr4, observer):
    """A push above the threshold moves the whole arm; released, the frame comes back slowly and without a jolt."""
    params = NullSpaceCellParameters()
    params.cell.obstacle = "nothing"
    params.controller.observer, params.controller.torque_threshold = observer, 30.0
    builder, push = DiagramBuilder(), np.zeros((7, 6))
    parts = add_null_space_cell(builder, lwr4, params)
    push[0, 2:4] = 45.0
    source = builder.AddSystem(TrajectorySource(PiecewisePolynomial.FirstOrderHold([0, 0.2, 0.4, 0.9, 1.1, 9.0], push)))
    builder.Connect(source.get_output_port(), parts.cell.plant.get_applied_generalized_force_input_port())
    recorder, pipeline = Recorder(builder, 0.002), parts.pipeline
    for system, name in (
        (pipeline.controller, "task_error"), (pipeline.controller, "yielding"), (pipeline.envelope, "torque_applied"),
        (pipeline.envelope, "torque_excess"), (pipeline.switch, "system_status"),
    ):  # fmt: skip
        recorder.add(name, system.GetOutputPort(name))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(5.0)
    log = recorder.log(diagram, simulator.get_context())
    error, yielding = np.linalg.norm(log["task_error"], axis=1), log["yielding"][:, 0]
    assert yielding.max() > 0.9 and error.max() > 0.1
    assert yielding[-1] == 0.0
    last = log.time[yielding > 0.05].max()
    assert last < 2.2  # the push has ended at 1.1 s
    back = log.time > last
    speed = np.linalg.norm(np.gradient(log["task_error"], log.time, axis=0), axis=1)
    assert speed[back].max() < 1.2 * params.controller.return_speed
    assert np.abs(np.diff(log["torque_applied"], axis=0)).max() <= 2.0 + 1e-9  # the envelope's rate
    assert np.all(log["torque_excess"][back] == 0.0) and np.all(log["system_status"] == SystemStatus.OK)
    assert error[-1] < 1e-3


def test_clone_goes_on_by_itself(lwr4):
    """What is remembered lives in the Context."""
    ports = Ports(lwr4, observer="momentum", torque_threshold=1.0)
    ports.run(0.01)
    twin = ports.context.Clone()
    ports.fix(torque_external=np.full(7, 100.0))
    ports.run(0.5)
    assert ports.read("yielding")[0] > 0.9 and ports.read("yielding", twin)[0] == 0.0
    ports.run(0.01, twin)
    np.testing.assert_array_equal(ports.read("task_error", twin), np.zeros(3))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("observer", ["none", "momentum", "task_error"])
@pytest.mark.parametrize(
    ("port", "size"),
    [
        ("dynamics", 0), ("torque_external", 7), ("torque_external_task", 7), ("desired_pose", 3),
        ("desired_velocity", 6), ("desired_acceleration", 6), ("nominal_posture", 7),
    ],
)  # fmt: skip
def test_an_input_that_is_not_finite_is_told_and_forgotten(lwr4, port, size, observer, bad):
    """The command is NaN, for the switch; nothing is remembered of it: afterwards all is as if it had not been."""
    ports, twin = (Ports(lwr4, observer=observer, torque_threshold=30.0) for _ in range(2))
    d, here = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)), ports.system.kinematics
    good = {"dynamics": AbstractValue.Make(d), "desired_pose": AbstractValue.Make(RigidTransform(here(d).p))}
    worse = {"dynamics": AbstractValue.Make(d.unknown()),
             "desired_pose": AbstractValue.Make(RigidTransform([bad, 0.0, 0.0]))}  # fmt: skip
    for each in (ports, twin):
        each.fix(torque_external=np.eye(7)[1] * 33.0)
        each.run(0.02)
    before = ports.read("yielding")
    ports.fix(**{port: worse.get(port, np.r_[np.zeros(max(size - 1, 0)), bad])})
    used = port != "torque_external_task" or observer == "task_error"
    status = SystemStatus.BAD_INPUT if used else SystemStatus.OK
    assert ports.read("system_status") == status
    assert np.isnan(ports.read("torque_commanded")).all() == used
    np.testing.assert_array_equal(ports.read("observer_drive"), 0.0)
    ports.run(0.02)
    if used:
        np.testing.assert_array_equal(ports.read("yielding"), before)
        ports.fix(**{port: good.get(port, np.zeros(size))})
        ports.fix(torque_external=np.eye(7)[1] * 33.0)
        ports.run(0.02)
    twin.run(0.02)
    np.testing.assert_allclose(ports.read("yielding"), twin.read("yielding"))
    assert ports.read("system_status") == SystemStatus.OK and np.isfinite(ports.read("torque_commanded")).all()


@pytest.mark.parametrize(
    ("observer", "threshold", "name"),
    [
        ("momentum", np.inf, "torque_external"), ("task_error", np.inf, "torque_external_task"),
        ("task_error", 30.0, "torque_external: not connected, but torque_threshold"),
        ("none", 30.0, "torque_external: not connected, but torque_threshold"),
    ],
)  # fmt: skip
def test_an_observer_without_its_input_says_which(lwr4, observer, threshold, name):
    params = NullSpaceComplianceParameters(observer=observer, torque_threshold=threshold)
    system = NullSpaceComplianceController(lwr4, params)
    with pytest.raises(StateError, match=name):
        _fixed(system, system.CreateDefaultContext(), lwr4)


def _fixed(system, context, robot):
    value = AbstractValue.Make(evaluate_dynamics(robot, robot.home, np.zeros(robot.n)))
    system.GetInputPort("dynamics").FixValue(context, value)
    return system.GetOutputPort("torque_commanded").Eval(context)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"observer": "perfect"}, "none, task_error, task_error_pd, momentum"),
        ({"task": "elbow"}, "position, pose"),
        ({"K_x": -1.0}, "K_x"),
        ({"P": [1.0, 2.0]}, "P"),
        ({"torque_threshold": 0.0}, "torque_threshold"),
        ({"null_damping": [1.0, np.nan]}, "null_damping"),
    ],
)
def test_bad_parameters_are_named(change, words):
    with pytest.raises((ParameterError, UnknownNameError), match=words):
        NullSpaceComplianceParameters(**change)


def test_bad_gains_for_the_arm_are_named(lwr4):
    """γ against its sufficient condition, sizes against the joints, the frame against the model."""
    for change, words in (
        ({"observer": "task_error_pd", "gamma": 50.0}, "gamma: must be below"),
        ({"null_stiffness": [1.0, 2.0]}, "null_stiffness"),
    ):
        with pytest.raises(ParameterError, match=words):
            NullSpaceComplianceController(lwr4, NullSpaceComplianceParameters(**change))
    with pytest.raises(UnknownNameError, match="gripper"):
        NullSpaceComplianceController(lwr4, NullSpaceComplianceParameters(frame="gripper"))
