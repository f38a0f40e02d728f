"""A signal passes until its fault begins, and is then what the fault makes of it."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, Sine

from saphari_drake.simulation.faults.signals import SignalFault, encoder, frozen, held_for, noisy, replaced, shifted

START, N = 0.1, 4


def spoiled(spoil, seconds=0.3):
    """Return time, signal and what the fault makes of it."""
    builder = DiagramBuilder()
    source = builder.AddSystem(Sine(np.ones(N), np.arange(5.0, 5.0 + N), 0.3 * np.ones(N)))
    fault = builder.AddSystem(SignalFault(N, spoil, START))
    builder.Connect(source.get_output_port(0), fault.get_input_port())
    logs = [
        LogVectorOutput(port, builder, 0.001) for port in (source.get_output_port(0), fault.GetOutputPort("faulty"))
    ]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(seconds)
    good, bad = (log.FindLog(simulator.get_context()) for log in logs)
    time = good.sample_times()
    before = time < START - 1e-9
    assert np.array_equal(good.data().T[before], bad.data().T[before])
    return time[~before] - START, good.data().T[~before], bad.data().T[~before]


def test_a_frozen_signal_keeps_its_last_value():
    _, good, bad = spoiled(frozen(np.array([2])))
    assert np.ptp(bad[:, 2]) == 0.0 and bad[0, 2] == pytest.approx(good[0, 2], abs=0.02)
    assert np.array_equal(np.delete(bad, 2, 1), np.delete(good, 2, 1))


def test_a_late_one_is_held_and_comes_back():
    since, good, bad = spoiled(held_for(0.02))
    assert np.ptp(bad[since < 0.0195], axis=0).max() == 0.0
    assert np.array_equal(bad[since > 0.0205], good[since > 0.0205])


def test_shifted_replaced_noisy():
    since, good, bad = spoiled(shifted(np.arange(4.0), 0.05))
    np.testing.assert_allclose((bad - good)[since < 0.0495], np.tile(np.arange(4.0), (sum(since < 0.0495), 1)))
    assert np.array_equal(bad[since > 0.0505], good[since > 0.0505])
    _, good, bad = spoiled(replaced(np.array([0, 3]), 7.0))
    assert np.all(bad[:, [0, 3]] == 7.0) and np.array_equal(bad[:, 1:3], good[:, 1:3])
    _, good, bad = spoiled(noisy(0.2 * np.ones(N), 3), 2.0)
    assert (bad - good).std(axis=0) == pytest.approx(0.2, rel=0.1)


def test_an_encoder_glitches_freezes_and_dies():
    """The state of two joints: positions, then velocities."""
    since, good, bad = spoiled(encoder("glitch", 1, 2, 0.1, 0.005))
    assert (bad - good)[since < 0.0045, 1] == pytest.approx(0.1) and np.array_equal(
        bad[since > 0.006], good[since > 0.006]
    )
    _, good, bad = spoiled(encoder("freeze", 1, 2))
    assert np.ptp(bad[:, 1]) == 0.0 and np.all(bad[:, 3] == 0.0) and np.array_equal(bad[:, 0], good[:, 0])
    _, _, bad = spoiled(encoder("nan", 0, 2))
    assert np.isnan(bad[:, [0, 2]]).all() and np.isfinite(bad[:, [1, 3]]).all()


def test_a_fault_acts_when_it_differs_by_more_than_the_floor():
    """Not a number always differs; a bias below the floor does not."""
    for offset, floor, acts in ((0.2, 0.1, 1.0), (0.2, 0.3, 0.0), (np.nan, 0.3, 1.0)):
        fault = SignalFault(N, shifted(np.full(N, offset)), 0.0, floor)
        context = fault.CreateDefaultContext()
        fault.get_input_port().FixValue(context, np.ones(N))
        assert fault.GetOutputPort("acts").Eval(context)[0] == acts
