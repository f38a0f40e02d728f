"""The self-check in a diagram: it warns of a displaced camera, waits while a person is near, and keeps its state."""

import numpy as np
import pytest
from bench import Bench
from experiments.localization.parameters import SceneParameters
from experiments.localization.scenes import ContactScenes
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import ParameterError
from saphari_drake.perception.camera.check_parameters import CameraCheckParameters, CheckStatus
from saphari_drake.perception.camera.check_system import CameraCheck, CheckScheduleParameters
from saphari_drake.perception.camera.model import CameraParameters, camera_pose

NOBODY, AWAY = np.zeros((0, 3)), np.full((40, 3), 2.0)


@pytest.fixture(scope="module")
def frames(lwr4):
    scenes = ContactScenes(lwr4, [CameraParameters()], SceneParameters(hands=1))
    rng = np.random.default_rng(1)
    wide = np.array([1.6, 0.8, 0.8, 0.8, 0.8, 0.8, 0.8])
    postures = [lwr4.home + wide * rng.uniform(-1.0, 1.0, lwr4.n) for _ in range(4)]
    return [(q, picture(scenes.noisy(scenes.images([], q)[0], 0, rng))) for q in postures]


def picture(depth):
    value = ImageDepth32F(640, 480)
    value.mutable_data[..., 0] = depth
    return value


def bench_of(lwr4, frames, shift=0.0, step=0.1):
    X_WC = camera_pose(CameraParameters())
    believed = RigidTransform(X_WC.rotation(), X_WC.translation() + [shift, 0.0, 0.0])
    system = CameraCheck(
        lwr4, CameraParameters(), schedule=CheckScheduleParameters(interval=0.2, step=step), X_WC=believed
    )
    return Bench(system, position_measured=frames[0][0], depth_image=frames[0][1], image_time=-1.0, human_points=NOBODY)


def show(bench, frame, human_points=NOBODY):
    """Rest in a posture for 0.2 s, then show its image, and wait for the check."""
    bench.run(40, position_measured=frame[0])
    bench.run(2, depth_image=frame[1], image_time=bench.cycles * 0.005, human_points=human_points)
    bench.run(200)


def test_camera_in_its_place_is_ok_and_nothing_is_known_before(lwr4, frames):
    bench = bench_of(lwr4, frames)
    assert bench.read("check_status") == CheckStatus.UNKNOWN
    np.testing.assert_array_equal(bench.read("extrinsic_error"), np.zeros(2))
    show(bench, frames[0])
    assert bench.read("check_status") == CheckStatus.OK
    assert bench.read("extrinsic_error")[0] < 0.003


def test_displaced_camera_warns_and_several_postures_correct_it(lwr4, frames):
    bench = bench_of(lwr4, frames, 0.012)
    for frame in frames:
        show(bench, frame)
    assert bench.read("check_status") == CheckStatus.WARNING
    assert bench.read("extrinsic_error")[0] == pytest.approx(0.012, abs=0.003)
    found = bench.read("correction").translation() + bench.read("correction").rotation().matrix() @ (
        camera_pose(CameraParameters()).translation() + [0.012, 0.0, 0.0]
    )
    assert np.linalg.norm(found - camera_pose(CameraParameters()).translation()) < 0.004


def all_over(lwr4, frame):
    """A person before all of the robot."""
    motion = lwr4.kinematics(frame[0])
    return np.concatenate([motion.p_WL + [x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])


def test_person_before_the_robot_makes_it_wait_and_the_last_error_stands(lwr4, frames):
    bench = bench_of(lwr4, frames, 0.012)
    show(bench, frames[0])
    error = bench.read("extrinsic_error")
    show(bench, frames[1], all_over(lwr4, frames[1]))
    assert bench.read("check_status") == CheckStatus.BUSY
    np.testing.assert_array_equal(bench.read("extrinsic_error"), error)
    show(bench, frames[1])
    assert bench.read("check_status") == CheckStatus.WARNING


def test_person_elsewhere_does_not_keep_the_robot_from_being_compared(lwr4, frames):
    bench = bench_of(lwr4, frames, 0.012)
    show(bench, frames[0], AWAY)
    assert bench.read("check_status") == CheckStatus.WARNING


def test_correction_comes_by_small_steps(lwr4, frames):
    """By 3 mm a check, where all at once would be 12 mm."""
    bench = bench_of(lwr4, frames, 0.012, step=0.003)
    moved = []
    for k in range(8):
        show(bench, frames[k % 4])
        moved.append(np.linalg.norm(bench.read("correction") @ lwr4.kinematics(frames[0][0]).p_WL[-1]
                                    - lwr4.kinematics(frames[0][0]).p_WL[-1]))  # fmt: skip
    assert np.all(np.diff([0.0, *moved]) < 0.0045)
    assert moved[-1] == pytest.approx(0.012, abs=0.002)


def test_more_postures_leave_less_covariance_and_none_leaves_that_of_the_prior(lwr4, frames):
    bench = bench_of(lwr4, frames)
    traces = [np.trace(bench.read("correction_covariance").reshape(6, 6))]
    prior = CameraCheckParameters()
    assert traces[0] == pytest.approx(3.0 * (prior.turn_prior**2 + prior.shift_prior**2))
    for frame in frames:
        show(bench, frame)
        traces.append(np.trace(bench.read("correction_covariance").reshape(6, 6)))
    assert traces[1] < traces[0]
    assert traces[4] < 0.3 * traces[1]


def test_camera_that_lies_on_the_floor_is_not_corrected(lwr4, frames):
    """What is farther off than allowed is said, and left to people."""
    X_WC = camera_pose(CameraParameters())
    believed = RigidTransform(X_WC.rotation(), X_WC.translation() + [0.02, 0.0, 0.0])
    bounds = CameraCheckParameters(most_shift=0.01)
    schedule = CheckScheduleParameters(interval=0.2)
    system = CameraCheck(lwr4, CameraParameters(), bounds, schedule, believed)
    bench = Bench(system, position_measured=frames[0][0], depth_image=frames[0][1], image_time=-1.0)
    for frame in frames[:2]:
        bench.run(40, position_measured=frame[0])
        bench.run(2, depth_image=frame[1], image_time=bench.cycles * 0.005)
        bench.run(200)
    assert bench.read("check_status") == CheckStatus.BEYOND
    assert bench.read("correction").IsNearlyIdentity(1e-12)


def test_moving_robot_and_empty_images_tell_nothing(lwr4, frames):
    bench = bench_of(lwr4, frames)
    for k in range(20):
        bench.run(1, position_measured=frames[0][0] + 0.01 * k)
    bench.run(1, depth_image=frames[0][1], image_time=bench.cycles * 0.005)
    assert bench.read("check_status") == CheckStatus.UNKNOWN
    show(bench, (frames[1][0], picture(np.zeros((480, 640), np.float32))))
    assert bench.read("check_status") == CheckStatus.UNKNOWN


def test_clone_goes_on_alike(lwr4, frames):
    bench = bench_of(lwr4, frames, 0.012)
    show(bench, frames[0])
    clone = bench.clone()
    for other in (bench, clone):
        show(other, frames[2])
    assert bench.read("check_status") == clone.read("check_status") == CheckStatus.WARNING
    np.testing.assert_array_equal(bench.read("extrinsic_error"), clone.read("extrinsic_error"))


def test_bad_input_is_named(lwr4, frames):
    with pytest.raises(ParameterError, match="interval"):
        CheckScheduleParameters(interval=0.0)
    with pytest.raises(ParameterError, match="period"):
        CameraCheck(lwr4, CameraParameters(), period=np.nan)


def test_frames_that_cannot_be_used_tell_nothing(lwr4, frames):
    """Of another size, or with a posture that is not finite; the next good one does."""
    bench = bench_of(lwr4, frames)
    show(bench, (frames[0][0], ImageDepth32F(3, 2)))
    assert bench.read("check_status") == CheckStatus.UNKNOWN
    show(bench, (np.full(7, np.nan), frames[0][1]))
    assert bench.read("check_status") == CheckStatus.UNKNOWN
    show(bench, frames[0])
    assert bench.read("check_status") == CheckStatus.OK
