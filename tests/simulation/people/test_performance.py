"""People's motions: placed, slowed down where a recording jumps, and smooth."""

import numpy as np
import pytest
from small_bvh import ORDER, swinging, write_bvh

from saphari_drake.simulation.people.performance import PerformanceParameters, performance
from saphari_drake.simulation.people.performance import played as played_at
from saphari_drake.simulation.people.skeleton import (
    HIP,
    L_SHOULDER,
    NECK,
    R_SHOULDER,
    R_WRIST,
    SEGMENTS,
    PersonSizes,
    segment_ends,
    standing,
)

SIZES = PersonSizes()


def played(tmp_path, frames, **params):
    path = write_bvh(tmp_path / "a.bvh", frames)
    return performance(PerformanceParameters(file=str(path), **params), SIZES)


def test_a_recording_stands_on_its_spot_and_looks_where_it_should(tmp_path):
    joints = played(tmp_path, np.zeros((50, 33)), spot=[1.0, 0.5], yaw=90.0).at(0.1)
    np.testing.assert_allclose(joints[HIP], [1.0, 0.5, SIZES.hip_height], atol=1e-9)
    np.testing.assert_allclose(joints[NECK] - joints[HIP], [0.0, 0.0, 0.32], atol=1e-9)
    left = joints[L_SHOULDER] - joints[R_SHOULDER]
    np.testing.assert_allclose(left / np.linalg.norm(left), [-1.0, 0.0, 0.0], atol=1e-9)


def test_no_joint_is_faster_than_it_may_be(tmp_path):
    """Time is stretched where the recording jumps, and goes by as recorded elsewhere."""
    frames = swinging()
    frames[100:, 3 + 3 * ORDER.index("right_upper_arm") + 2] += 60.0
    person = played(tmp_path, frames, max_speed=1.0)
    speed = np.linalg.norm(np.diff(person.joints, axis=0), axis=2) * person.rate
    assert speed.max() <= 1.0 + 1e-6
    assert len(person.joints) > 200


def test_it_is_played_forth_and_back_without_a_jump(tmp_path):
    person = played(tmp_path, swinging())
    times = np.arange(0.0, 5.0, 0.01)
    path = np.array([person.at(time)[R_WRIST] for time in times])
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 1.7 * 0.01
    for at in (30.3, 123.4, 250.2, 350.7):
        (before, _), (after, change) = (played_at(person.joints, at + h) for h in (-1e-3, 1e-3))
        np.testing.assert_allclose(change, (after - before) / 2e-3, atol=1e-6)


def test_a_made_up_person_reaches_and_goes():
    params = PerformanceParameters(reach_to=[0.6, -0.1, 1.1], reach_speed=2.0, reach_until=8.0)
    person = performance(params, SIZES)
    np.testing.assert_allclose(person.at(5.0)[R_WRIST], [0.6, -0.1, 1.1], atol=0.15)
    np.testing.assert_allclose(person.at(0.0)[R_WRIST] - person.at(0.0)[HIP], person.at(12.0)[R_WRIST] - person.at(
        12.0)[HIP], atol=1e-9)  # fmt: skip


def test_segments_are_where_the_joints_are():
    ends = segment_ends(standing(SIZES), SIZES)
    names = [segment.name for segment in SEGMENTS]
    assert ends.shape == (len(SEGMENTS), 2, 3)
    hand = ends[names.index("right hand")]
    assert np.linalg.norm(hand[1] - hand[0]) == pytest.approx(SIZES.hand_length)
    assert ends[names.index("left leg"), 1, 2] == pytest.approx(SIZES.leg)
    assert ends[names.index("head"), 0, 2] > ends[names.index("trunk"), :, 2].max()
