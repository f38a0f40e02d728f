"""The joint sensor: resolution, sampling, velocity by differences."""

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters, quantize

Q, V = np.linspace(-1.0, 1.0, 7), np.linspace(0.3, -0.4, 7)
EXACT = JointSensorParameters(position_resolution=0.0, differentiate=False)


@pytest.fixture
def bench(lwr4):
    return lambda params=None, q=Q, v=V: Bench(JointSensor(lwr4, params), state=np.r_[q, v])


@pytest.mark.parametrize("resolution", [1e-5, 0.01, 0.25])
def test_quantization_is_within_half_a_step(resolution):
    values = np.random.default_rng(0).uniform(-3, 3, 1000)
    rounded = quantize(values, resolution)
    assert np.max(np.abs(rounded - values)) <= resolution / 2 * (1 + 1e-9)
    np.testing.assert_allclose(rounded / resolution, np.round(rounded / resolution), atol=1e-9)
    np.testing.assert_array_equal(quantize(values, 0.0), values)


def test_first_sample_is_taken_at_the_start(bench):
    """Nothing downstream sees the home posture of a robot that stands elsewhere."""
    sensor = bench()
    np.testing.assert_allclose(sensor.read("position_measured"), Q, atol=0.5e-5)
    np.testing.assert_array_equal(sensor.read("velocity_measured"), V)


def test_outputs_are_held_between_samples(bench):
    sensor = bench(EXACT)
    sensor.set(state=np.r_[Q + 1.0, V + 1.0])
    np.testing.assert_array_equal(sensor.read("position_measured"), Q)
    sensor.run()
    np.testing.assert_array_equal(sensor.read("position_measured"), Q + 1.0)
    np.testing.assert_array_equal(sensor.read("velocity_measured"), V + 1.0)


def test_velocity_is_the_difference_of_the_last_two_positions(bench):
    """Its error is bounded by one encoder step a period, and does not add up."""
    resolution = 1e-4
    sensor = bench(JointSensorParameters(position_resolution=resolution))
    for k in range(1, 50):
        sensor.run(state=np.r_[Q + k * PERIOD * V, 99.0 * np.ones(7)])
        assert np.max(np.abs(sensor.read("velocity_measured") - V)) <= resolution / PERIOD * (1 + 1e-6)


def test_velocity_resolution_when_it_is_measured(bench):
    sensor = bench(JointSensorParameters(velocity_resolution=0.1, differentiate=False))
    sensor.run()
    np.testing.assert_allclose(sensor.read("velocity_measured"), np.round(V / 0.1) * 0.1, atol=1e-12)


def test_clone_of_the_context_goes_on_by_itself(bench):
    sensor = bench()
    sensor.run()
    twin = sensor.clone()
    twin.run(state=np.r_[Q + 0.1, V])
    np.testing.assert_allclose(sensor.read("position_measured"), Q, atol=1e-5)
    np.testing.assert_allclose(twin.read("velocity_measured"), 0.1 / PERIOD, atol=2e-3)
    sensor.run(state=np.r_[Q + 0.1, V])
    for port in ("position_measured", "velocity_measured"):
        np.testing.assert_array_equal(sensor.read(port), twin.read(port))


@pytest.mark.parametrize(
    ("name", "value"),
    [("period", 0.0), ("period", np.nan), ("position_resolution", -1e-5), ("velocity_resolution", -0.1)],
)
def test_bad_parameters(name, value):
    with pytest.raises(ParameterError, match=name):
        JointSensorParameters(**{name: value})
