"""The whole cell with its camera: a push is felt, found and answered; a lost camera stops the arm within 0.1 s."""

import numpy as np
import pytest
from experiments.contact import judge
from experiments.contact.cell import ContactCellParameters, add_contact_cell
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.momentum_observer import MomentumObserverParameters
from saphari_drake.messages import CameraStatus, InteractionMode
from saphari_drake.pipelines.contact import ContactPipelineParameters
from saphari_drake.robots.catalog import lwr4
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.sensors.depth_noise import SamplerParameters
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters
from saphari_drake.simulation.world.cell import contact_truth

HOME = np.deg2rad([90.0, -30.0, 0.0, 60.0, 0.0, -90.0, 0.0])


class Run:
    """A cell with one push, simulated with its camera."""

    def __init__(self, push, params=None, renderer="auto"):
        self.robot, self.push = lwr4(home=HOME), push
        params = params or ContactCellParameters()
        params.camera.renderer = renderer
        builder = DiagramBuilder()
        self.parts = parts = add_contact_cell(builder, self.robot, [push], params)
        self.recorder = recorder = Recorder(builder, 0.005)
        p, cell = parts.pipeline, parts.cell
        recorder.add("position", cell.robot_state, "rad", lambda x: x[:7])
        recorder.add("velocity", cell.robot_state, "rad/s", lambda x: x[7:])
        recorder.add("torque", p.torque_output, "Nm")
        recorder.add("mode", p.monitor.GetOutputPort("mode"), "1")
        recorder.add("camera_status", p.localizer.GetOutputPort("camera_status"), "1")
        recorder.add("active_link", p.monitor.GetOutputPort("active_contact"), "index", lambda c: [c.link])
        recorder.add("contact", p.detector.GetOutputPort("contact"), "1")
        recorder.add("contact_force", p.force.GetOutputPort("contact_force"), "N")
        recorder.add("contact_position", p.controller.GetOutputPort("contact_position"), "m")
        recorder.add("contact_truth", cell.contact_results, "N", lambda r: contact_truth(r, cell), 7)
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)

    def to(self, time):
        self.simulator.AdvanceTo(time)
        return self.recorder.log(self.diagram, self.simulator.get_context())


def test_a_push_is_felt_found_and_answered_with_open3d_s_camera():
    """With the ray-casting camera and Kinect noise: right link, point within 10 mm, force within 10 %."""
    push = Push("link_6", direction=[0.0, -1.0, 0.0], start=0.1, hold=1.9)
    run = Run(push, renderer="raycast")
    log = run.to(2.3)
    (touch,) = judge.find_touches(log, run.robot, [push])
    assert judge.detection_delay(log, touch) <= 0.05
    found = judge.localized(log, touch)
    assert found.link_right > 0.95 and found.unanswered < 0.05
    assert found.median < 0.010
    assert judge.force_error(log, touch) < 0.10
    assert judge.deflection_error(log, run.robot, touch, np.full(3, 500.0)) < 0.10


@pytest.mark.parametrize("fault, status", [("silent", CameraStatus.STALE), ("invalid", CameraStatus.INVALID)])
def test_a_lost_camera_stops_the_arm_within_a_tenth_of_a_second(fault, status):
    """During a contact the camera fails: published, and the mode is STOP, within 0.1 s; the arm comes to rest."""
    push = Push("link_6", direction=[0.0, -1.0, 0.0], force=15.0, start=0.1, hold=1.2)
    params = ContactCellParameters(sampler=SamplerParameters(fault=fault, fault_time=1.2))
    run = Run(push, params)
    log = run.to(2.5)
    stopped = log.time[np.flatnonzero(log["mode"][:, 0] == InteractionMode.STOP)]
    assert log["mode"][np.searchsorted(log.time, 1.1), 0] == InteractionMode.CONTACT
    assert 1.2 < stopped[0] <= 1.3
    assert np.all(log["mode"][log.time >= stopped[0], 0] == InteractionMode.STOP)
    assert log["camera_status"][-1, 0] == status
    assert np.abs(log["velocity"][-1]).max() < 0.02
    step = np.abs(np.diff(log["torque"], axis=0))[log.time[1:] > 1.15].max()
    assert step < 6.0  # Nm a cycle: the stop is no jerk


def test_the_arm_holds_again_when_the_camera_works_again():
    """After some frames without reading the stop ends in a hold where the arm is."""
    push = Push("link_6", direction=[0.0, -1.0, 0.0], start=50.0, hold=1.0)
    params = ContactCellParameters(sampler=SamplerParameters(fault="invalid", fault_time=0.3, fault_frames=3))
    log = Run(push, params).to(1.5)
    modes = log["mode"][:, 0]
    assert InteractionMode.STOP in modes
    assert modes[-1] == InteractionMode.HOLD
    np.testing.assert_allclose(log["position"][-1], HOME, atol=1e-3)


def test_a_cloned_context_runs_to_the_same_state():
    """All state is in the Context: two clones, advanced apart, agree to the last bit."""
    push = Push("link_6", direction=[0.0, -1.0, 0.0], start=0.0, hold=1.0)
    run = Run(push)
    run.simulator.AdvanceTo(0.8)
    context = run.simulator.get_context()
    ends = []
    for _ in range(2):
        simulator = Simulator(run.diagram, context.Clone())
        simulator.AdvanceTo(1.0)
        ends.append(run.parts.cell.robot_state.Eval(run.parts.cell.plant.GetMyContextFromRoot(simulator.get_context())))
    np.testing.assert_array_equal(*ends)
    assert np.linalg.norm(ends[0][7:]) > 0.01


def test_a_part_with_a_period_of_its_own_is_refused():
    """The cycle is the pipeline's."""
    with pytest.raises(ParameterError, match="observer.period: is that of the pipeline"):
        ContactPipelineParameters(observer=MomentumObserverParameters(period=0.002))
    with pytest.raises(ParameterError, match="joint_sensor.period: is that of the pipeline"):
        ContactCellParameters(joint_sensor=JointSensorParameters(period=0.002))
    params = ContactCellParameters(pipeline=ContactPipelineParameters(period=0.002))
    assert params.joint_sensor.period == params.pipeline.monitor.period == 0.002
