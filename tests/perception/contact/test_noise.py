"""The deviation of a residual while nobody touches: measured, and assumed as long as little is measured."""

import numpy as np

from saphari_drake.perception.contact.noise import QuietNoise


def test_deviation_goes_from_what_is_assumed_to_what_is_measured_and_not_below_the_least():
    rng, sigma = np.random.default_rng(0), np.array([0.2, 0.001])
    quiet, told = QuietNoise(np.zeros(2)), np.array([0.3, np.nan])
    np.testing.assert_allclose(quiet.deviation(0.05, told), [0.3, 0.05])
    for _ in range(400):
        quiet = quiet.after(sigma * rng.normal(size=2))
    assert abs(quiet.deviation(0.05, told)[0] - 0.2) < 0.06
    assert quiet.deviation(0.05, told)[1] == 0.05
