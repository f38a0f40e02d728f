"""The noise has the stated statistics, and frames come at the stated times, the same for the same Context."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.simulation.sensors.depth_noise import (
    DepthCameraSampler,
    DepthNoiseParameters,
    SamplerParameters,
    add_kinect_noise,
)
from saphari_drake.simulation.sensors.depth_noise_kernels import noisy_image

CAMERA = CameraParameters(width=160, height=120)
PLAIN = DepthNoiseParameters(edge_missing=0.0, edge_flying=0.0, shadow=False)


def flat(depth):
    return np.full((480, 640), depth, dtype=np.float32)


def noise_of_walls(depth, params=PLAIN, count=12):
    """Errors of flat walls around a depth, which the rounding of the disparity meets at all phases."""
    depths = depth * (1.0 + 0.002 * np.arange(count))
    return np.stack([add_kinect_noise(flat(z), np.random.default_rng(i), params) - z for i, z in enumerate(depths)])


@pytest.mark.parametrize("depth", [1.0, 1.7, 3.0])
def test_deviation_is_as_stated_and_grows_with_the_square_of_depth(depth):
    expected = 0.004 * (depth / 1.7) ** 2
    error = noise_of_walls(depth)
    assert error.std() == pytest.approx(expected, rel=0.1)
    assert abs(error.mean()) < 0.1 * expected


def test_noise_is_correlated_over_a_few_pixels_only():
    error = noise_of_walls(1.7)
    near = np.corrcoef(error[:, :, 1:].ravel(), error[:, :, :-1].ravel())[0, 1]
    far = np.corrcoef(error[:, :, 12:].ravel(), error[:, :, :-12].ravel())[0, 1]
    assert 0.2 < near < 0.5
    assert abs(far) < 0.03


def test_disparity_comes_in_steps():
    reading = add_kinect_noise(flat(1.7), np.random.default_rng(0), PLAIN)
    disparity = 575.0 * 0.075 / reading[reading > 0.0]
    np.testing.assert_allclose(disparity * 8.0, np.rint(disparity * 8.0), atol=1e-3)


def test_no_noise_is_left_with_all_of_it_switched_off():
    exact = flat(1.7)
    exact[100:200, 200:300] = 1.2
    silent = DepthNoiseParameters(sigma=0.0, disparity_step=0.0, edge_missing=0.0, edge_flying=0.0, shadow=False)
    np.testing.assert_allclose(add_kinect_noise(exact, np.random.default_rng(0), silent), exact, rtol=1e-6)
    assert add_kinect_noise(exact, np.random.default_rng(0), DepthNoiseParameters(enabled=False)) is exact


def test_no_reading_stays_none_and_far_readings_are_lost():
    exact = flat(1.7)
    exact[:10], exact[10:20], exact[20:30], exact[30:40] = np.inf, np.nan, 0.0, 6.0
    noisy = add_kinect_noise(exact, np.random.default_rng(0), PLAIN)
    assert np.all(noisy[:40] == 0.0)
    assert np.all(noisy[45:] > 0.0)


def test_edges_lose_and_mix_readings():
    exact = flat(1.7)
    exact[:, 320:] = 1.2
    params = DepthNoiseParameters(shadow=False)
    band = np.concatenate(
        [add_kinect_noise(exact, np.random.default_rng(i), params)[:, 318:322].ravel() for i in range(5)]
    )
    assert np.mean(band == 0.0) == pytest.approx(params.edge_missing, abs=0.03)
    flying = (band > 1.25) & (band < 1.65)
    assert 0.5 * params.edge_flying < np.mean(flying) < params.edge_flying
    noisy = add_kinect_noise(exact, np.random.default_rng(0), params)
    assert np.all(noisy[:, :310] > 0.0) and np.all(noisy[:, 330:] > 0.0)


def test_projector_shadow_has_the_width_that_the_baseline_gives():
    exact = flat(1.7)
    exact[100:200, 300:400] = 1.0
    params = DepthNoiseParameters(edge_missing=0.0, edge_flying=0.0)
    noisy = add_kinect_noise(exact, np.random.default_rng(0), params)
    dark = np.flatnonzero(noisy[150] == 0.0)
    width = 575.0 * 0.075 * (1.0 / 1.0 - 1.0 / 1.7)
    assert dark.max() == 299  # left of the body, as the projector is on the right
    assert len(dark) == pytest.approx(width, abs=2.0)
    assert np.all(noisy[50] > 0.0)


def test_grazing_surfaces_lose_readings():
    # A floor seen from 0.3 m above: the farther, the flatter the rays meet it.
    y = (np.arange(480) + 0.5 - 240.0) / 575.0
    depth = np.where(y > 0.0, 0.3 / np.maximum(y, 1e-9), np.inf)
    exact = np.repeat(depth[:, None], 640, axis=1).astype(np.float32)
    lost = (add_kinect_noise(exact, np.random.default_rng(0), PLAIN) == 0.0).mean(axis=1)
    angle = np.arctan(depth / 0.3)
    assert np.all(lost[(angle < 1.2) & (depth > 0.45)] == 0.0)
    for low in (1.25, 1.3, 1.35, 1.4):
        rows = (angle > low) & (angle < low + 0.03)
        start, end = np.tan(PLAIN.grazing_start), np.tan(PLAIN.grazing_end)
        expected = (np.tan(angle[rows]) - start) / (end - start)
        assert lost[rows].mean() == pytest.approx(expected.mean(), abs=0.05)


def test_noise_is_a_function_of_the_seed():
    a, b, c = (add_kinect_noise(flat(1.5), np.random.default_rng(seed), PLAIN) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert np.any(a != c)


# ---- the sampler ---------------------------------------------------------------------------------------------------


def sampler(**params):
    system = DepthCameraSampler(CAMERA, SamplerParameters(**params))
    simulator = Simulator(system)
    image = ImageDepth32F(CAMERA.width, CAMERA.height)
    image.mutable_data[:] = 1.5
    system.GetInputPort("depth_image").FixValue(simulator.get_mutable_context(), AbstractValue.Make(image))
    return system, simulator


def outputs(system, context):
    image = system.GetOutputPort("depth_image").Eval(context).data[..., 0].copy()
    return image, system.GetOutputPort("image_time").Eval(context)[0]


def test_frames_are_delivered_after_the_latency_with_the_time_they_were_taken():
    system, simulator = sampler(latency=0.01)
    context = simulator.get_mutable_context()
    stamps = []
    for time in np.arange(1, 140) * 1e-3:
        simulator.AdvanceTo(time)
        stamps.append(outputs(system, context)[1])
    stamps = np.array(stamps)
    assert np.all(stamps[:9] == -1.0)
    assert stamps[10] == pytest.approx(0.0, abs=1e-5)
    for frame in range(1, 4):
        arrival = np.flatnonzero(stamps > frame / 30.0 - 1e-3)[0] * 1e-3 + 1e-3
        assert arrival == pytest.approx(frame / 30.0 + 0.01, abs=1.1e-3)
    assert len(np.unique(stamps)) == 5


@pytest.mark.parametrize("latency", [0.0, 1.0 / 30.0, 0.08])
def test_any_latency_delivers_every_frame(latency):
    system, simulator = sampler(latency=latency)
    seen = set()
    for time in np.arange(1, 400) * 1e-3:
        simulator.AdvanceTo(time)
        seen.add(outputs(system, simulator.get_context())[1])
    expected = {-1.0} if latency > 0.0 else set()
    expected |= {k / 30.0 + 1e-6 for k in range(12) if k / 30.0 + latency < 0.3985}
    assert sorted(seen) == pytest.approx(sorted(expected), abs=1e-9)


def test_cloned_context_gives_the_same_images():
    system, simulator = sampler()
    simulator.AdvanceTo(0.15)
    clone = simulator.get_context().Clone()
    other = Simulator(system, clone)
    simulator.AdvanceTo(0.31)
    other.AdvanceTo(0.31)
    (a, ta), (b, tb) = outputs(system, simulator.get_context()), outputs(system, clone)
    assert ta == tb > 0.2
    np.testing.assert_array_equal(a, b)
    assert a.std() > 0.0


def test_frames_differ_from_one_another():
    system, simulator = sampler()
    simulator.AdvanceTo(0.02)
    first, _ = outputs(system, simulator.get_context())
    simulator.AdvanceTo(0.05)
    second, _ = outputs(system, simulator.get_context())
    assert np.any(first != second)


def test_silent_fault_stops_frames_for_its_length():
    system, simulator = sampler(fault="silent", fault_time=0.1, fault_frames=3)
    stamps = set()
    for time in np.arange(1, 300) * 1e-3:
        simulator.AdvanceTo(time)
        stamps.add(round(outputs(system, simulator.get_context())[1] * 30.0))
    assert stamps == {-30, 0, 1, 2, 6, 7, 8}


def test_invalid_fault_delivers_frames_without_readings():
    system, simulator = sampler(fault="invalid", fault_time=0.1)
    simulator.AdvanceTo(0.09)
    assert np.mean(outputs(system, simulator.get_context())[0] > 0.0) > 0.9
    simulator.AdvanceTo(0.2)
    image, stamp = outputs(system, simulator.get_context())
    assert stamp > 0.15
    assert not np.any(image > 0.0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("baseline", 0.0),
        ("sigma", -1.0),
        ("correlated_share", 1.5),
        ("correlation_length", 0.5),
        ("edge_missing", -0.1),
        ("edge_flying", 0.9),
        ("grazing_end", 1.0),
    ],
)
def test_bad_noise_parameters_are_named(field, value):
    with pytest.raises(ParameterError) as error:
        DepthNoiseParameters(**{field: value})
    assert error.value.field == field


def test_bad_sampler_parameters_are_named():
    for field, value in (("latency", -0.1), ("fault_time", np.nan), ("fault_frames", -1.0)):
        with pytest.raises(ParameterError) as error:
            SamplerParameters(**{field: value})
        assert error.value.field == field
    with pytest.raises(UnknownNameError, match="silent"):
        SamplerParameters(fault="quiet")


def test_an_image_that_may_not_be_written_to_is_measured_alike_by_the_same_kernel():
    exact = flat(1.5)
    fixed = exact.copy()
    fixed.flags.writeable = False
    mine = add_kinect_noise(exact, np.random.default_rng(0), PLAIN)
    kernels = len(noisy_image.signatures)
    np.testing.assert_array_equal(add_kinect_noise(fixed, np.random.default_rng(0), PLAIN), mine)
    assert exact.flags.writeable and len(noisy_image.signatures) == kernels
