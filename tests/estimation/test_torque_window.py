"""The torque that a sampled momentum is compared with is the one that changed it."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.torque_window import TorqueWindow, window_weights

STEP, COUNT = 0.001, 5


@pytest.mark.parametrize("differenced", [True, False])
def test_the_mean_is_what_changes_the_sampled_velocity(differenced):
    """A mass under torques that jump in every step: m Δv/T to rounding; a mean over one period is off by their size."""
    rng, bench = np.random.default_rng(0), Bench(TorqueWindow(1, STEP, COUNT * STEP, differenced), torque_acting=[0.0])
    torque = np.concatenate([np.zeros(12), rng.normal(size=200)])
    v = np.concatenate([[0.0], STEP * np.cumsum(torque)])
    q = np.concatenate([[0.0], STEP * np.cumsum(v[1:])])
    for j in range(200):
        bench.set(torque_acting=[torque[j]])
        told = bench.read("torque_mean")
        end = j + 1
        if end >= 12:
            sampled = (q[end] - q[end - COUNT]) / (COUNT * STEP) if differenced else v[end]
            k = end - COUNT
            before = (q[k] - q[k - COUNT]) / (COUNT * STEP) if differenced else v[k]
            assert told == pytest.approx((sampled - before) / (COUNT * STEP), abs=1e-9)
        bench.simulator.AdvanceTo(STEP * (j + 1) + 2e-6)


def test_weights_add_up_and_sizes_are_checked():
    for count in (1, 4):
        for differenced in (True, False):
            assert window_weights(count, differenced).sum() == pytest.approx(1.0)
    assert len(window_weights(4, True)) == 7
    with pytest.raises(ParameterError, match="count"):
        window_weights(0, True)
    with pytest.raises(ParameterError, match="period"):
        TorqueWindow(7, 0.001, 0.0025, True)
