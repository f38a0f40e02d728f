"""One value that is not finite, in each input of each torque pipeline: the chain holds, and goes on afterwards."""

import numpy as np
import pytest
from measured_loop import contact_loop, null_space_loop, see
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.messages import SystemStatus
from saphari_drake.pipelines.contact import ContactPipelineParameters

BAD = [np.nan, np.inf, -np.inf]
DURATIONS = [2, 7, 300]  # ms; the last one never ends
HOLD = 2e-3  # m; what the wrist may move


@pytest.fixture(scope="module", params=["momentum", "task_error"])
def null_space(lwr4, request):
    return null_space_loop(lwr4, observer=request.param)


@pytest.fixture(scope="module", params=["impedance", "force"])
def contact(lwr4, request):
    params = ContactPipelineParameters()
    if request.param == "force":
        params.controller = ContactForceControlParameters()
    return contact_loop(lwr4, params)


def check(loop, spoiled, duration, each=lambda loop: None, notices=True):
    """Spoil for a while in the middle of a run at rest; return the status during the fault and at the end."""
    loop.restart()
    loop.run(100, each)
    start, good = loop.wrist, {name: loop.zeros[name] for name in spoiled}
    loop.spoil(**spoiled)
    torques, statuses = loop.run(duration, each)
    if duration < max(DURATIONS):
        loop.spoil(**good)
        after = loop.run(300, each)
        torques, ended = np.vstack((torques, after[0])), after[1][-1]
        assert ended == SystemStatus.OK
    assert np.isfinite(torques).all() and np.all(np.abs(torques) <= loop.robot.tau_max)
    assert np.linalg.norm(loop.wrist - start) < HOLD
    if notices and duration >= 7:  # longer than any cycle
        assert np.any(statuses != SystemStatus.OK)
    assert np.isfinite(loop.read(loop.pipeline[1], "torque_external")).all() or duration == max(DURATIONS)
    return statuses


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("duration", DURATIONS)
@pytest.mark.parametrize("port", ["position_measured", "velocity_measured"])
def test_null_space_pipeline_with_a_joint_sensor_that_fails(null_space, port, duration, bad):
    """A state that is not known asks for the brakes."""
    statuses = check(null_space, {port: np.r_[0.0, bad, np.zeros(5)]}, duration)
    assert duration < 7 or statuses[-1] == SystemStatus.BRAKES_ON


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("duration", DURATIONS)
@pytest.mark.parametrize("port", ["desired_pose", "desired_velocity", "desired_acceleration", "nominal_posture"])
def test_null_space_pipeline_with_a_target_that_is_none(null_space, port, duration, bad):
    """The posture is held."""
    value = np.r_[bad, np.zeros(6 if port == "nominal_posture" else 5)]
    spoiled = AbstractValue.Make(RigidTransform([bad, 0.0, 0.5])) if port == "desired_pose" else value
    statuses = check(null_space, {port: spoiled}, duration)
    assert duration < 7 or statuses[-1] == SystemStatus.HOLDING


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("duration", DURATIONS)
@pytest.mark.parametrize("port", ["velocity_measured"])
def test_contact_pipeline_with_a_joint_sensor_that_fails(contact, port, duration, bad):
    statuses = check(contact, {port: np.r_[0.0, bad, np.zeros(5)]}, duration, see)
    assert duration < 7 or statuses[-1] == SystemStatus.BRAKES_ON


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("duration", DURATIONS)
def test_contact_pipeline_with_a_camera_that_fails(contact, duration, bad):
    """Nothing of it reaches the switch: the monitor stops, which is compliant."""
    image = ImageDepth32F(640, 480)
    image.mutable_data[..., 0] = bad
    blind = check(contact, {"depth_image": Value[ImageDepth32F](image)}, duration, see, notices=False)
    undated = check(contact, {"image_time": np.array([bad])}, duration, notices=False)
    assert set(blind) == set(undated) == {SystemStatus.OK}
