"""The wired pipeline: port contracts, and that every torque comes from the sampled state."""

import numpy as np
import pytest
from experiments.contact.cycle_time import time_cycles
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.messages import InteractionMode
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.pipelines.contact import ContactPipelineParameters, add_contact_pipeline
from saphari_drake.robots.catalog import lwr4
from saphari_drake.robots.dynamics import evaluate_dynamics


@pytest.fixture(scope="module")
def pipeline():
    builder = DiagramBuilder()
    parts = add_contact_pipeline(builder, lwr4(), CameraParameters())
    builder.ExportInput(parts.state_input, "state")
    builder.ExportInput(parts.depth_input, "depth_image")
    builder.ExportInput(parts.image_time_input, "image_time")
    builder.ExportOutput(parts.torque_output, "torque_commanded")
    return parts, builder.Build()


def test_three_inputs_make_one_torque(pipeline):
    """All other ports are connected; sizes are 2n, image, 1 and n."""
    _, diagram = pipeline
    assert diagram.num_input_ports() == 3
    assert diagram.GetInputPort("state").size() == 14
    assert diagram.GetInputPort("image_time").size() == 1
    assert diagram.GetOutputPort("torque_commanded").size() == 7


def test_the_torque_does_not_depend_on_the_state_between_samples(pipeline):
    """No direct feedthrough: what reaches the joints is a function of held samples."""
    _, diagram = pipeline
    assert not diagram.HasAnyDirectFeedthrough()


def test_at_rest_the_torque_is_gravity(pipeline):
    """Holding its posture at rest, before any frame is overdue, the arm carries its weight and nothing else."""
    parts, diagram = pipeline
    robot = lwr4()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("state").FixValue(context, np.r_[robot.home, np.zeros(7)])
    diagram.GetInputPort("depth_image").FixValue(context, Value[ImageDepth32F](ImageDepth32F(640, 480)))
    diagram.GetInputPort("image_time").FixValue(context, [-1.0])
    simulator.AdvanceTo(0.05)
    torque = diagram.GetOutputPort("torque_commanded").Eval(context)
    np.testing.assert_allclose(torque, evaluate_dynamics(robot, robot.home, np.zeros(7)).g, atol=0.02)
    assert parts.monitor.GetOutputPort("mode").Eval(parts.monitor.GetMyContextFromRoot(context))[0] == 0.0
    simulator.AdvanceTo(0.15)  # no frame came: the camera is overdue
    mode = parts.monitor.GetOutputPort("mode").Eval(parts.monitor.GetMyContextFromRoot(context))[0]
    assert mode == InteractionMode.STOP


def test_cycles_are_timed_one_by_one():
    """Each cycle has a time, and frames come at the camera's rate."""
    robot = lwr4()
    states = np.tile(np.r_[robot.home, np.zeros(7)], (100, 1))
    far = np.full((480, 640), 3.0, dtype=np.float32)
    seconds, with_frame = time_cycles(robot, CameraParameters(), ContactPipelineParameters(), states, far)
    assert len(seconds) == 60 and np.all(seconds > 0.0)
    assert np.count_nonzero(with_frame) in (8, 9, 10)
