"""Frames of a run: what the sampler delivered, in millimetres, at a bounded rate, of one run alone."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.simulation.record.frames import FrameKeeper, millimetres
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler, SamplerParameters

CAMERA = CameraParameters(width=4, height=3, rate=30.0)
DEPTH = np.linspace(0.5, 4.0, 12, dtype=np.float32).reshape(3, 4)
DEPTH[0, 0], DEPTH[2, 3] = np.inf, 0.0


def diagram():
    builder, image, params = DiagramBuilder(), ImageDepth32F(4, 3), SamplerParameters()
    image.mutable_data[..., 0] = DEPTH
    params.noise.enabled = False
    source = builder.AddSystem(ConstantValueSource(Value(image)))
    sampler = builder.AddNamedSystem("watcher", DepthCameraSampler(CAMERA, params))
    builder.Connect(source.get_output_port(), sampler.GetInputPort("depth_image"))
    return builder.Build()


def test_frames_are_those_delivered():
    keeper = FrameKeeper()
    Simulation(diagram(), options=RunOptions(frames=keeper)).to(1.0)
    times = np.array([frame.time for frame in keeper.frames])
    assert 8 <= len(times) <= 11 and np.all(np.diff(times) > 0.05)
    np.testing.assert_allclose(30.0 * times, np.round(30.0 * times), atol=1e-3)  # frames of the camera, not between
    for frame in keeper.frames:
        assert frame.name == "watcher" and frame.camera is CAMERA
        pixels = np.frombuffer(frame.pixels, "<u2").reshape(3, 4)
        assert pixels[0, 0] == pixels[2, 3] == 0
        seen = pixels > 0
        assert seen.sum() == 10
        np.testing.assert_allclose(1e-3 * pixels[seen], DEPTH[seen], atol=5.1e-4)


def test_of_several_runs_nothing_is_shown():
    keeper = FrameKeeper()
    for _ in range(2):
        Simulation(diagram(), options=RunOptions(frames=keeper)).to(0.2)
    assert len(keeper.frames) == 0


@pytest.mark.parametrize(("depth", "pixel"), [(np.nan, 0), (np.inf, 0), (-np.inf, 0), (1.2346, 1235), (100.0, 65535)])
def test_millimetres(depth, pixel):
    assert millimetres(np.array([[depth]], dtype=np.float32))[0, 0] == pixel
