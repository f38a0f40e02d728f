"""Frames that are frozen, late, blind or noisy from the start of a fault on."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.simulation.faults.frames import CameraMoves, FrameFault, blind, noisier

SIZE = 60, 40
START = 0.1


def image(value):
    picture = ImageDepth32F(*SIZE)
    picture.mutable_data[..., 0] = value
    return picture


def shown(fault, seconds=0.3, rate=100.0):
    """Deliver frames whose depth is their number; return rows of time, stamp and the frame's middle and corner."""
    simulator = Simulator(fault)
    context = simulator.get_mutable_context()
    rows = []
    for k in range(int(seconds * rate)):
        fault.GetInputPort("depth_image").FixValue(context, AbstractValue.Make(image(1.0 + k)))
        fault.GetInputPort("image_time").FixValue(context, [k / rate])
        simulator.AdvanceTo(k / rate + 0.005)
        depth = fault.GetOutputPort("depth_image").Eval(context).data[..., 0]
        rows.append((k / rate, fault.GetOutputPort("image_time").Eval(context)[0], depth[20, 30], depth[0, 0]))
    return np.array(rows)


def test_a_frozen_camera_has_fresh_times():
    rows = shown(FrameFault(*SIZE, START, lambda image, shown, number: shown))
    assert np.array_equal(rows[:, 0], rows[:, 1])
    begun = rows[:, 0] > START + 0.001
    assert np.all(rows[begun, 2] == rows[~begun, 2][-1])


def test_a_late_camera_and_a_dead_one():
    rows = shown(FrameFault(*SIZE, START, delay=0.05))
    late = rows[rows[:, 0] > START + 0.06]
    assert late[:, 0] - late[:, 1] == pytest.approx(0.05, abs=0.0101)
    rows = shown(FrameFault(*SIZE, START, delay=np.inf))
    begun = rows[:, 0] > START + 0.001
    assert np.all(rows[begun, 1] == rows[~begun, 1][-1])


def test_a_blind_patch_and_noise():
    rows = shown(FrameFault(*SIZE, START, blind(0.34)))
    after = rows[rows[:, 0] > START]
    assert np.all(after[:, 2] == 0.0) and np.all(after[:, 3] > 0.0)
    clean = np.full((200, 200), 2.0, dtype=np.float32)
    noise = noisier(0.004, 1.7, 1)(clean.copy(), clean, 5) - clean
    assert noise.std() == pytest.approx(np.sqrt(8.0) * 0.004 * (2.0 / 1.7) ** 2, rel=0.05)
    assert np.all(noisier(0.004, 1.7, 1)(np.zeros((4, 4), dtype=np.float32), clean, 5) == 0.0)


def test_a_camera_that_moves_shows_the_other_view():
    system = CameraMoves(*SIZE, START)
    context = system.CreateDefaultContext()
    for name, value in (("before", 1.0), ("after", 2.0)):
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(image(value)))
    assert system.get_output_port().Eval(context).data.max() == 1.0
    context.SetTime(START)
    assert system.get_output_port().Eval(context).data.min() == 2.0
