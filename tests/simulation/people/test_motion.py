"""The human-motion player: files with each defect, their repair, placement, interpolation, ports."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.messages import ObstacleStatus
from saphari_drake.simulation.people.motion import HumanMotionParameters, HumanPath, camera_to_world
from saphari_drake.simulation.people.motion_files import JOINTS, HumanRecording, read_human_motion, synthetic_recording
from saphari_drake.simulation.people.motion_repair import JointState, repair_motion

RATE = 30.0
REPAIR = {"rate": RATE, "max_speed": 2.0, "max_gap": 0.2, "hold_time": 0.5}


def rows(count=90):
    """A slow, smooth motion of all joints, as rows of 18 columns."""
    return synthetic_recording(RATE, count / RATE).points.reshape(count, 18).copy()


def write(folder, data, name="person.txt"):
    path = folder / name
    np.savetxt(path, data)
    return path


def played(data, **params):
    """Path of a person from rows, without filter unless asked for."""
    recording = HumanRecording(np.asarray(data).reshape(-1, 6, 3), "test")
    return HumanPath(HumanMotionParameters(**{"smoothing": 0.0, **params}), recording)


def test_a_file_comes_back_as_it_was_written(tmp_path):
    """Rows without defects are read unchanged."""
    data = rows()
    np.testing.assert_allclose(read_human_motion(write(tmp_path, data)).points.reshape(-1, 18), data, atol=1e-12)


def test_lost_joints_become_nan(tmp_path):
    """NaN and a joint all zeros are readings that are missing; a single zero coordinate is not."""
    data = rows()
    data[3, 0] = np.nan
    data[5, 3:6] = 0.0
    data[7, 6] = 0.0
    points = read_human_motion(write(tmp_path, data)).points
    assert np.isnan(points[3, 0]).all() and np.isnan(points[5, 1]).all()
    assert np.isfinite(points[7, 2]).all()
    assert np.isnan(points).sum() == 6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no such file"),
        ("", "holds no frame"),
        ("1 2 3\n", "line 1 has 3 columns, 18 are needed"),
        (" ".join(["1.0"] * 18) + "\n" + " ".join(["1.0"] * 17) + "\n", "line 2 has 17 columns"),
        (" ".join(["x"] * 18), "line 1: could not convert"),
        (" ".join(["0"] * 18) + "\n" + " ".join(["nan"] * 18), "no joint is seen in any of its 2 frames"),
    ],
)
def test_what_cannot_be_used_is_told(tmp_path, text, message):
    """A missing file, a wrong number of columns, text and a file without any reading are errors that say where."""
    path = tmp_path / "person.txt"
    if text is not None:
        path.write_text(text)
    with pytest.raises(SensorError, match=message):
        HumanPath(HumanMotionParameters(file=str(path)))


def test_readings_that_never_agree_are_refused():
    """A recording in which every joint jumps in every frame holds no motion."""
    data = np.random.default_rng(0).uniform(-50.0, 50.0, (20, 6, 3))
    with pytest.raises(SensorError, match="no joint is seen steadily"):
        repair_motion(HumanRecording(data, "noise"), **REPAIR)


def test_short_gap_is_interpolated():
    """Up to the stated time a missing joint moves straight on, and is told as repaired."""
    data = rows()
    truth = data.copy().reshape(-1, 6, 3)
    data[20:24, 0:3] = np.nan
    repaired = repair_motion(HumanRecording(data.reshape(-1, 6, 3), "gap"), **REPAIR)
    assert np.all(repaired.state[20:24, 0] == JointState.REPAIRED)
    assert np.all(repaired.state[20:24, 1:] == JointState.SEEN)
    line = np.linspace(truth[19, 0], truth[24, 0], 6)[1:-1]
    np.testing.assert_allclose(repaired.points[20:24, 0], line, atol=1e-12)


def test_long_gap_is_held_then_lost_then_caught_up():
    """In a long gap the joint rests where it was last seen, and is back in time without ever being too fast."""
    data = rows()
    data[20:60, 0:3] = np.nan
    repaired = repair_motion(HumanRecording(data.reshape(-1, 6, 3), "gap"), **REPAIR)
    state = repaired.state[20:60, 0]
    assert np.all(state[:15] == JointState.HELD) and np.all(state[16:] == JointState.LOST)
    np.testing.assert_array_equal(repaired.points[20:40, 0], np.tile(repaired.points[19, 0], (20, 1)))
    np.testing.assert_array_equal(repaired.points[60, 0], data.reshape(-1, 6, 3)[60, 0])
    speed = np.linalg.norm(np.diff(repaired.points, axis=0), axis=2) * RATE
    assert speed.max() <= 2.0 + 1e-9


def test_jump_is_rejected_and_counted():
    """A wrist that jumps by 18 cm for two frames never leaves its way by that much."""
    data = rows()
    truth = data.copy().reshape(-1, 6, 3)
    data[30:32, 3:6] += [0.0, 0.0, 0.18]
    repaired = repair_motion(HumanRecording(data.reshape(-1, 6, 3), "jump"), **REPAIR)
    assert repaired.rejected == 2
    assert np.linalg.norm(repaired.points - truth, axis=2).max() < 0.01


def test_a_joint_found_elsewhere_is_accepted_after_a_while():
    """A lasting shift is a person who moved: it is followed once the speed limit allows it."""
    data = rows(60).reshape(-1, 6, 3)
    data[30:, 0] += [0.0, 0.0, 0.3]
    repaired = repair_motion(HumanRecording(data, "shift"), **REPAIR)
    assert 3 <= repaired.rejected <= 5
    np.testing.assert_array_equal(repaired.points[40:, 0], data[40:, 0])


def test_an_outlier_at_the_start_is_not_believed():
    """The first reading has no past: it must agree with what follows."""
    data = rows(30).reshape(-1, 6, 3)
    truth = data[0, 0].copy()
    data[0, 0] += 5.0
    repaired = repair_motion(HumanRecording(data, "start"), **REPAIR)
    assert np.linalg.norm(repaired.points[0, 0] - truth) < 0.05
    assert repaired.state[0, 0] == JointState.HELD


def test_joint_never_seen_is_left_out_and_told():
    """Points that need a joint which is in no frame do not exist, and the others are told as not complete."""
    data = rows()
    whole = played(data)
    data[:, 15:18] = 0.0
    data[:, 15:18] = np.nan
    path = played(data)
    assert path.count == whole.count - 1 - 2  # the shoulder and the points on that upper arm
    points = path(1.0)
    assert np.all(np.isfinite(points.p_WO)) and points.status == ObstacleStatus.HELD


def test_status_follows_the_worst_joint():
    """OK while all are seen, HELD when one is held, LOST when for too long; positions stay finite throughout."""
    data = rows(120)
    data[30:80, 6:9] = np.nan
    path = played(data, rate=RATE)
    statuses = {time: path(time).status for time in (0.5, 1.2, 2.0, 3.5)}
    assert list(statuses.values()) == [ObstacleStatus.OK, ObstacleStatus.HELD, ObstacleStatus.LOST, ObstacleStatus.OK]
    for time in np.arange(0.0, 4.0, 0.02):
        assert np.all(np.isfinite(path(time).p_WO)) and np.all(np.isfinite(path(time).v_WO))


@pytest.mark.parametrize("loop", [True, False])
def test_velocities_are_those_of_the_positions(loop):
    """Published velocities equal finite differences of published positions, played forth and back."""
    path = HumanPath(HumanMotionParameters(loop=loop))
    h = 1e-5
    times = [3.217, 11.84, 20.03] + ([30.11, 40.77] if loop else [])
    for time in times:
        difference = (path(time + h).p_WO - path(time - h).p_WO) / (2.0 * h)
        np.testing.assert_allclose(path(time).v_WO, difference, atol=1e-6)


def test_positions_are_continuous_through_the_turns():
    """A loop runs forth and back: the person never jumps, nor at its ends."""
    path = HumanPath(HumanMotionParameters())
    times = np.arange(path.duration - 0.1, path.duration + 0.1, 1e-3)
    steps = np.linalg.norm(np.diff([path(t).p_WO for t in times], axis=0), axis=2)
    assert steps.max() < 1.0 * 1e-3


def test_person_waits_before_and_rests_after_the_recording():
    """Outside the recording the person stands still, which is told."""
    path = HumanPath(HumanMotionParameters(start=-2.0, loop=False))
    for time in (1.0, 2.0 + path.duration + 1.0):
        points = path(time)
        assert points.status == ObstacleStatus.HELD
        np.testing.assert_array_equal(points.v_WO, 0.0)
    assert path(5.0).status == ObstacleStatus.OK
    np.testing.assert_allclose(path(1.9999).p_WO, path(2.0001).p_WO, atol=1e-3)


def test_placement():
    """A point straight ahead of the recording's camera lies where the transform puts it, scaled about the camera."""
    data = np.tile([0.0, 0.0, 0.5], (30, 6)) + np.repeat(np.arange(6), 3) * 1e-3
    for scale in (1.0, 2.0):
        params = {"position": [1.0, 2.0, 0.3], "rpy_deg": [-90.0, 0.0, -90.0], "scale": scale, "hand": 0.0}
        path = played(data, **params)
        X_WC = camera_to_world(HumanMotionParameters(**params))
        np.testing.assert_allclose(X_WC.rotation().matrix()[:, 2], [1.0, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(X_WC.rotation().matrix()[:, 1], [0.0, 0.0, -1.0], atol=1e-12)
        np.testing.assert_allclose(path(0.3).p_WO[0], X_WC @ (scale * data[0, :3]), atol=1e-9)


def test_points_cover_the_arms():
    """No place of an arm's axis lies farther from the nearest point than that point's radius."""
    path = HumanPath(HumanMotionParameters())
    X_WC = camera_to_world(path.params)
    for time in (2.0, 9.0):
        points = path(time)
        joints = np.array([X_WC @ p for p in path.repaired.points[round(time * RATE)]])
        for a, b in ((0, 2), (2, 4), (1, 3), (3, 5)):
            for share in np.linspace(0.0, 1.0, 21):
                p = (1.0 - share) * joints[a] + share * joints[b]
                assert np.min(np.linalg.norm(points.p_WO - p, axis=1) - points.radius) < 0.0


def test_one_frame_is_a_person_at_rest():
    """A path needs three readings of a joint that agree; three equal ones are a person who stands still."""
    path = played(np.tile(rows(1), (3, 1)))
    np.testing.assert_allclose(path(0.05).v_WO, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"rate": 0.0}, "rate"),
        ({"position": [0.0, 1.0]}, "position"),
        ({"rpy_deg": [0.0, np.nan, 0.0]}, "rpy_deg"),
        ({"radius": [0.1, 0.1, -0.1]}, "radius"),
        ({"start": np.inf}, "start"),
        ({"max_gap": -0.1}, "max_gap"),
    ],
)
def test_bad_parameters_are_named(change, field):
    """A parameter that cannot be used is an error that names it."""
    with pytest.raises(ParameterError, match=field):
        HumanMotionParameters(**change)


def test_joint_names():
    """Rows hold left before right, wrists before elbows before shoulders."""
    assert JOINTS[0] == "left_wrist" and JOINTS[3] == "right_elbow" and len(JOINTS) == 6
    assert isinstance(camera_to_world(HumanMotionParameters()), RigidTransform)
