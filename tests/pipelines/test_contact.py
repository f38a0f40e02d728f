"""The wired pipeline: port contracts, and that every torque comes from the sampled state."""

import numpy as np
import pytest
from experiments.contact.cycle_time import time_cycles
from measured_loop import contact_loop, see

from saphari_drake.messages import InteractionMode
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.pipelines.contact import ContactPipelineParameters
from saphari_drake.robots.catalog import lwr4
from saphari_drake.robots.dynamics import evaluate_dynamics


@pytest.fixture(scope="module")
def loop():
    return contact_loop(lwr4())


def test_at_rest_the_torque_is_gravity_and_a_camera_that_is_overdue_stops(loop):
    """Holding its posture at rest, before any frame is overdue, the arm carries its weight and nothing else."""
    loop.restart()
    torques, _ = loop.run(50)
    robot, monitor = loop.robot, loop.pipeline.monitor
    np.testing.assert_allclose(torques[-1], evaluate_dynamics(robot, robot.home, np.zeros(7)).g, atol=0.02)
    assert loop.read(monitor, "mode") == InteractionMode.HOLD
    loop.run(100)  # no frame came
    assert loop.read(monitor, "mode") == InteractionMode.STOP


def test_the_observer_is_fed_what_is_applied(loop):
    """A push from outside is all that it finds: also while the torque limit cuts."""
    loop.restart()
    loop.run(300, see)
    push = np.array([0.0, 8.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    loop.spoil(push=push)
    loop.run(100, see)
    np.testing.assert_allclose(loop.read(loop.pipeline.observer, "torque_external"), push, atol=0.5)
    assert loop.read(loop.pipeline.detector, "contact") == 1.0


def test_torque_changes_with_the_cycle_alone(loop):
    """What reaches the joints is a function of held samples: equal over each 5 ms, whatever the arm does between."""
    loop.restart()
    loop.run(100, see)
    loop.spoil(push=np.full(7, 2.0))
    torques, _ = loop.run(100, see)
    changes = np.flatnonzero(np.any(np.diff(torques, axis=0) != 0.0, axis=1))
    assert len(changes) > 10 and np.all((changes - changes[0]) % 5 == 0)


@pytest.mark.parametrize("part", ["observer", "detector", "monitor", "controller", "switch"])
def test_parts_take_the_period_of_the_pipeline(part):
    params = ContactPipelineParameters(period=0.002)
    assert getattr(params, part).period == 0.002


def test_cycles_are_timed_one_by_one():
    """Each cycle has a time, and frames come at the camera's rate."""
    robot = lwr4()
    states = np.tile(np.r_[robot.home, np.zeros(7)], (100, 1))
    far = np.full((480, 640), 3.0, dtype=np.float32)
    seconds, with_frame = time_cycles(robot, CameraParameters(), ContactPipelineParameters(), states, far)
    assert len(seconds) == 60 and np.all(seconds > 0.0)
    assert np.count_nonzero(with_frame) in (8, 9, 10)
