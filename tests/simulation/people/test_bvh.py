"""BVH files: where the joints are, in closed form, and what is refused."""

import numpy as np
import pytest
from small_bvh import ORDER, swinging, write_bvh

from saphari_drake.errors import SensorError
from saphari_drake.simulation.people.bvh import read_bvh


def test_joints_are_where_rotations_put_them(tmp_path):
    """Right arm by 90° about z, then its forearm by 90° about x: both in the frame that the parent left."""
    frames = np.zeros((2, 33))
    frames[:, :3] = [[0, 0, 0], [10, 20, 30]]
    frames[1, 3 + 3 * ORDER.index("right_upper_arm")] = 90.0
    frames[1, 3 + 3 * ORDER.index("right_forearm") + 1] = 90.0
    recording = read_bvh(write_bvh(tmp_path / "a.bvh", frames, 50.0))
    assert recording.names == tuple(ORDER) and recording.rate == pytest.approx(50.0)
    at = {name: recording.points[:, k] for k, name in enumerate(ORDER)}
    np.testing.assert_allclose(at["right_hand"][0], [150 + 270 + 250, 310, 0])
    np.testing.assert_allclose(at["right_forearm"][1], [10 + 150, 20 + 310 + 270, 30], atol=1e-9)
    np.testing.assert_allclose(at["right_hand"][1], [10 + 150, 20 + 310 + 270 + 250, 30], atol=1e-9)
    np.testing.assert_allclose(at["left_hand"][1], [10 - 670, 20 + 310, 30], atol=1e-9)


def test_bones_keep_their_length(tmp_path):
    points = read_bvh(write_bvh(tmp_path / "a.bvh", swinging())).points
    length = np.linalg.norm(points[:, ORDER.index("right_hand")] - points[:, ORDER.index("right_forearm")], axis=1)
    np.testing.assert_allclose(length, 250.0)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda text: "", "HIERARCHY"),
        (lambda text: text.replace("Frames: 3", "Frames: 4"), "tells 4 frames"),
        (lambda text: text.rstrip() + " 1\n", "has 34 values"),
        (lambda text: text.replace("OFFSET 0 320 0", "OFFSET 0 x 0"), "hierarchy cannot be read"),
        (lambda text: text.replace("Zrotation Xrotation", "Wrotation Xrotation", 1), "Wrotation"),
        (lambda text: text.replace("MOTION", "}\nMOTION"), "hierarchy cannot be read"),
        (lambda text: text.replace("Frame Time: 0.01", "Frame Time: 0"), "frames of 0"),
        (lambda text: text.rstrip()[:-1] + "nan\n", "not finite"),
    ],
)
def test_what_is_no_such_file_is_told(tmp_path, change, told):
    path = write_bvh(tmp_path / "a.bvh", np.zeros((3, 33)))
    path.write_text(change(path.read_text()))
    with pytest.raises(SensorError, match=told):
        read_bvh(path)


def test_a_joint_that_is_not_there_is_told(tmp_path):
    with pytest.raises(SensorError, match=r"no joint 'knee'; there are: hip"):
        read_bvh(write_bvh(tmp_path / "a.bvh", np.zeros((1, 33)))).index("knee")
