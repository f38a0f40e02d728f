"""A recorded force as a push: scaled, turned, lifted into the friction cone, and no further."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.simulation.people.force_recording import ForceRecording
from saphari_drake.simulation.people.recorded_push import RecordedPushParameters, recorded_push


def recording(seed, mean=(1.0, 0.0, -2.0)):
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 5.0, 301)
    force = np.array(mean) + rng.normal(size=(3, 3)).dot(np.sin(np.outer([1.0, 2.3, 4.1], time))).T
    return ForceRecording(time, force, "test")


def played(push, params, step=0.01):
    times = np.arange(push.start + params.blend, push.end - params.blend, step)
    return np.array([push.profile(t) for t in times])


@given(seed=st.integers(0, 50), angle=st.floats(0.0, 6.28))
def test_the_push_stays_in_the_friction_cone_and_presses(seed, angle):
    """A fingertip can do it: it presses with the least force, and tangential force stays below its share."""
    params = RecordedPushParameters()
    direction = np.array([np.cos(angle), np.sin(angle), 0.3])
    push = recorded_push(recording(seed), direction, params)
    force = played(push, params)
    unit = direction / np.linalg.norm(direction)
    normal = force @ unit
    tangential = np.linalg.norm(force - np.outer(normal, unit), axis=1)
    assert np.all(normal > 0.0)
    assert np.all(tangential <= params.friction_used * normal + 1e-9)


def test_the_bias_is_the_least_that_does():
    """With a little less the force would leave the cone."""
    params = RecordedPushParameters(blend=0.01)
    push = recorded_push(recording(1), [0.0, -1.0, 0.0], params)
    force = played(push, params, 0.001)
    normal = -force[:, 1]
    tangential = np.hypot(force[:, 0], force[:, 2])
    assert np.min(normal - tangential / params.friction_used) == pytest.approx(params.least, abs=0.05)


def test_the_varying_part_is_the_recording_scaled_and_turned():
    """Lengths of differences are those of the recording times the scale; the largest force has the peak's size."""
    params, source = RecordedPushParameters(peak=12.0), recording(2)
    push = recorded_push(source, [0.0, 0.0, -1.0], params)
    assert push.scale * np.linalg.norm(source.force, axis=1).max() == pytest.approx(12.0)
    a, b = source.time[100], source.time[200]
    moved = push.profile(push.start + b) - push.profile(push.start + a)
    assert np.linalg.norm(moved) == pytest.approx(push.scale * np.linalg.norm(source.force[200] - source.force[100]))


def test_before_the_recording_the_plain_push_acts():
    """The profile starts after the lead."""
    push = recorded_push(recording(3), [0.0, -1.0, 0.0], RecordedPushParameters(lead=1.5))
    assert push.profile(1.4) is None
    np.testing.assert_allclose(push.profile(1.5), [0.0, -push.bias, 0.0], atol=1e-9)


def test_a_recording_without_force_is_refused():
    """Nothing can be scaled to the peak."""
    empty = ForceRecording(np.linspace(0.0, 1.0, 11), np.zeros((11, 3)), "silence.csv")
    with pytest.raises(SensorError, match="silence.csv: holds no force"):
        recorded_push(empty, [1.0, 0.0, 0.0], RecordedPushParameters())


def test_bad_parameters_are_named():
    """Each field is checked."""
    for field in ("peak", "friction_used", "least", "lead", "blend"):
        with pytest.raises(ParameterError, match=field):
            RecordedPushParameters(**{field: -1.0})
