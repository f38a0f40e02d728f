"""Judgement of the skin on made-up logs: what is missed counts in full, the worst touch decides."""

import numpy as np
import pytest
from experiments.guiding.touches import SkinTouch, skin_metrics, skin_touches

from saphari_drake.errors import SensorError

ON, OFF = 3.0, 1.5
POINT = np.array([0.0, 0.06, 0.1])


def made_up(count=400):
    """Two touches of 5 N with ramps, which the skin finds 1 mm off and without error of force."""
    size = np.zeros(count)
    for start in (50, 250):
        size[start : start + 100] = np.interp(np.arange(100), [0, 20, 80, 99], [0.0, 5.0, 5.0, 0.0])
    force = size[:, None] * np.array([0.0, -1.0, 0.0])
    contact = np.where(size[:, None] > 0.5, np.append(POINT + [0.001, 0.0, 0.0], force[60]), 0.0)
    return force, force.copy(), contact


def judged(force, estimated, contact):
    return {m.name: m for m in skin_metrics(skin_touches(force, estimated, contact, POINT, ON, OFF))}


def test_both_touches_are_found_and_nothing_is_missed():
    metrics = judged(*made_up())
    assert metrics["skin_touches"].value == 2
    assert metrics["skin_force_error_relative"].value == 0.0 and metrics["skin_missed_share"].value == 0.0
    assert metrics["skin_point_error_m"].value == pytest.approx(0.001)
    assert all(metric.met for metric in metrics.values())


def test_a_touch_that_is_missed_counts_as_a_hundred_per_cent():
    """The other one, found without error, does not thin it out; even a force that is guessed right does not help."""
    force, estimated, contact = made_up()
    contact[200:] = 0.0
    metrics = judged(force, estimated, contact)
    assert metrics["skin_force_error_relative"].value == 1.0
    assert metrics["skin_missed_share"].value == 1.0
    assert metrics["skin_point_error_m"].value == np.inf
    assert not any(metrics[name].met for name in metrics if name != "skin_touches")


def test_the_worst_touch_decides():
    force, estimated, contact = made_up()
    estimated[200:] *= 0.9
    contact[200:, 0] += np.where(contact[200:, 1] > 0.0, 0.006, 0.0)
    metrics = judged(force, estimated, contact)
    assert metrics["skin_force_error_relative"].value == pytest.approx(0.1)
    assert metrics["skin_point_error_m"].value == pytest.approx(0.007)


def test_samples_missed_within_a_touch_are_counted():
    force, estimated, contact = made_up()
    firm = np.flatnonzero(np.linalg.norm(force, axis=1) > ON)
    missed = firm[:8]
    contact[missed], estimated[missed] = 0.0, 0.0
    (first, second) = skin_touches(force, estimated, contact, POINT, ON, OFF)
    assert first.missed_share == pytest.approx(8 / (len(firm) / 2)) and second.missed_share == 0.0
    assert first.force_error == pytest.approx(np.sqrt(first.missed_share))
    assert not {m.name: m for m in skin_metrics([first, second])}["skin_missed_share"].met


def test_a_dip_within_a_touch_does_not_split_it_and_a_graze_is_none():
    force, estimated, contact = made_up()
    force[90:95] *= 0.4  # 2 N: above the lower force
    force[380:390, 1] = -2.0
    assert len(skin_touches(force, estimated, contact, POINT, ON, OFF)) == 2


def test_no_touch_is_no_success():
    force, estimated, contact = made_up()
    assert skin_touches(0.0 * force, estimated, contact, POINT, ON, OFF) == []
    with pytest.raises(SensorError, match="nobody touches"):
        skin_metrics([])
    assert skin_metrics([SkinTouch(0.0, 0.0, 0.0)], "_3x")[0].name == "skin_force_error_relative_3x"
