"""The camera self-check finds a displaced camera, and where it really is."""

import numpy as np
import pytest
from experiments.localization.parameters import SceneParameters
from experiments.localization.scenes import ContactScenes
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.errors import ParameterError, StateError
from saphari_drake.math.rotations import axis_rotation
from saphari_drake.perception.camera.check import check_camera
from saphari_drake.perception.camera.check_parameters import CameraCheckParameters, CheckStatus
from saphari_drake.perception.camera.model import CameraParameters, camera_pose


@pytest.fixture(scope="module")
def frames(lwr4):
    scenes = ContactScenes(lwr4, [CameraParameters()], SceneParameters(hands=1))
    rng = np.random.default_rng(1)
    wide = np.array([1.6, 0.8, 0.8, 0.8, 0.8, 0.8, 0.8])
    postures = [lwr4.home + wide * rng.uniform(-1.0, 1.0, lwr4.n) for _ in range(8)]
    return postures, [scenes.noisy(scenes.images([], q)[0], 0, rng) for q in postures]


def displaced(metres, degrees, seed):
    """Where the camera is taken to be, off in a random direction."""
    rng = np.random.default_rng(seed)
    shift, axis = (a / np.linalg.norm(a) for a in rng.normal(size=(2, 3)))
    X_WC = camera_pose(CameraParameters())
    R = axis_rotation(axis, np.deg2rad(degrees)) @ X_WC.rotation().matrix()
    return RigidTransform(RotationMatrix(R), X_WC.translation() + metres * shift)


def left_over(check, X_WC):
    error = check.X_correct @ X_WC @ camera_pose(CameraParameters()).inverse()
    position = (check.X_correct @ X_WC).translation() - camera_pose(CameraParameters()).translation()
    cosine = (np.trace(error.rotation().matrix()) - 1.0) / 2.0
    return np.linalg.norm(position), np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def test_camera_in_its_place_is_ok(lwr4, frames):
    check = check_camera(lwr4, CameraParameters(), *frames)
    assert check.status == CheckStatus.OK
    assert check.displacement < 0.001


@pytest.mark.parametrize("seed", range(2))
def test_ten_millimetres_and_a_degree_are_recovered(lwr4, frames, seed):
    X_WC = displaced(0.010, 1.0, seed)
    check = check_camera(lwr4, CameraParameters(), *frames, X_WC=X_WC)
    assert check.status == CheckStatus.WARNING
    metres, degrees = left_over(check, X_WC)
    assert metres < 0.002
    assert degrees < 0.1
    assert check.residual_after < check.residual_before


def test_one_posture_warns(lwr4, frames):
    check = check_camera(lwr4, CameraParameters(), frames[0][:1], frames[1][:1], X_WC=displaced(0.02, 0.0, 3))
    assert check.status == CheckStatus.WARNING


def test_error_lies_within_three_deviations_of_its_covariance(lwr4, frames):
    """Of the whole pose, in the mean over random displacements, also after one posture that shows it in part."""
    squares = []
    for seed in range(6):
        X_WC, some = displaced(0.005, 0.3, seed), [seed]
        for used in (some, range(8)):
            check = check_camera(
                lwr4, CameraParameters(), [frames[0][i] for i in used], [frames[1][i] for i in used], X_WC=X_WC
            )
            left = check.X_correct @ X_WC
            true = camera_pose(CameraParameters())
            turn = (true.rotation() @ left.rotation().inverse()).ToAngleAxis()
            error = np.concatenate([turn.angle() * turn.axis(), true.translation() - left.translation()])
            squares.append(error @ np.linalg.solve(check.covariance, error) / 6.0)
    assert np.mean(squares) < 9.0


def test_directions_that_are_not_seen_stay(lwr4, frames):
    """A turn and a shift that a single posture cannot tell apart are not made up; two robots' worth of them are."""
    one = check_camera(lwr4, CameraParameters(), frames[0][:1], frames[1][:1])
    all_ = check_camera(lwr4, CameraParameters(), *frames)
    assert one.observable < 6
    assert all_.observable == 6
    value, _ = np.linalg.eigh(one.covariance)
    assert value.max() > 0.2 * CameraCheckParameters().shift_prior ** 2


def test_robot_out_of_view_is_unknown(lwr4):
    empty = [np.zeros((480, 640), np.float32)]
    assert check_camera(lwr4, CameraParameters(), [lwr4.home], empty).status == CheckStatus.UNKNOWN


def test_bad_input_is_named(lwr4):
    with pytest.raises(StateError, match="images"):
        check_camera(lwr4, CameraParameters(), [lwr4.home], [])
    with pytest.raises(StateError, match="postures"):
        check_camera(lwr4, CameraParameters(), [np.full(7, np.nan)], [np.zeros((480, 640), np.float32)])
    with pytest.raises(ParameterError, match="least_points"):
        CameraCheckParameters(least_points=3)
