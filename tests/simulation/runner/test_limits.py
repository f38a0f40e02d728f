"""The metrics of the joints' limits: the largest sample of the worst joint, and no sample lost."""

import numpy as np
import pytest

from saphari_drake.errors import StateError
from saphari_drake.robots import catalog
from saphari_drake.simulation.runner.limits import limit_metrics


def test_the_worst_joint_of_any_sample_counts_whatever_its_sign():
    robot = catalog.lwr4()
    velocity, excess = np.zeros((50, 7)), np.zeros((50, 7))
    velocity[7, 6] = -1.5 * robot.v_max[6]
    velocity[:, 0] = 0.9 * robot.v_max[0]
    excess[49, 2] = -4.0
    share, torque = limit_metrics(robot, velocity, excess)
    assert share.name == "joint_speed_share_max" and share.value == pytest.approx(1.5)
    assert torque.name == "torque_excess_max" and torque.value == 4.0 and torque.unit == "Nm"
    for metric in (share, torque):
        assert not metric.met and not metric.decides and metric.verdict == "(fail)"


def test_within_the_limits_both_pass():
    robot = catalog.lwr4()
    share, torque = limit_metrics(robot, np.ones((3, 1)) * robot.v_max, np.zeros((3, 7)))
    assert share.value == 1.0 and share.met and torque.value == 0.0 and torque.met


def test_an_arm_without_torques_has_no_torque_metric():
    (share,) = limit_metrics(catalog.lwr4(), np.zeros((2, 7)), None)
    assert share.name == "joint_speed_share_max" and share.value == 0.0


def test_a_platform_has_forces_too():
    robot = catalog.load("omnirob")
    assert limit_metrics(robot, np.zeros((2, robot.n)), np.zeros((2, robot.n)))[1].unit == "Nm, N"


def test_a_value_that_is_no_number_is_not_overlooked():
    velocity = np.zeros((4, 7))
    velocity[2, 3] = np.nan
    assert not limit_metrics(catalog.lwr4(), velocity, None)[0].met


@pytest.mark.parametrize("shape", [(0, 7), (5, 6), (7,)])
def test_samples_of_another_shape_are_refused(shape):
    with pytest.raises(StateError, match="velocity: needs rows of 7 joints"):
        limit_metrics(catalog.lwr4(), np.zeros(shape), None)
