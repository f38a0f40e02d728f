"""Torque sensors: noise of the deviation that is told, the same again for the same seed and time."""

import numpy as np
from bench import Bench

from saphari_drake.simulation.sensors.joint_torque_sensor import JointTorqueSensor


def readings(seed, noise=0.05, count=300):
    bench = Bench(JointTorqueSensor(7, seed, noise), torque=np.arange(7.0))
    found = []
    for _ in range(count):
        bench.run(1)
        found.append(bench.read("torque_measured"))
    return np.array(found)


def test_noise_is_as_told_and_follows_from_the_seed():
    first = readings(0)
    np.testing.assert_allclose(first.mean(axis=0), np.arange(7.0), atol=0.015)
    np.testing.assert_allclose(first.std(axis=0), 0.05, rtol=0.2)
    np.testing.assert_array_equal(first[:20], readings(0, count=20))
    assert np.all(first[:20] != readings(1, count=20))
    np.testing.assert_array_equal(readings(0, noise=0.0, count=2), np.tile(np.arange(7.0), (2, 1)))
