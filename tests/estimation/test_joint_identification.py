"""An arm is identified from torques of which the truth is known."""

import numpy as np
import pytest

from saphari_drake.errors import StateError
from saphari_drake.estimation.excitation import ExcitationParameters, draw_excitation
from saphari_drake.estimation.joint_identification import Motion, fourier_fit, identify, inverse_dynamics, regressor
from saphari_drake.robots.corrections import RobotCorrections, corrected
from saphari_drake.robots.dynamics import evaluate_dynamics

PERIOD, HARMONICS = 8.0, 5
TRUE = RobotCorrections(
    coulomb=[0.5, 0.4, 0.3, 0.3, 0.2, 0.2, 0.1],
    viscous=[2.0, 1.5, 1.0, 1.0, 0.5, 0.5, 0.3],
    rotor_inertia=[0.12, 0.08, 0.12, 0.1, 0.05, 0.05, 0.02],
    link_scale=[1.0, 1.03, 0.97, 1.02, 1.0, 1.0, 1.0],
    payload=1.5,
    payload_centre=[0.01, -0.02, 0.08],
)
BIAS = np.array([0.2, -0.2, 0.1, 0.0, -0.1, 0.1, 0.2])


@pytest.fixture(scope="module")
def recording(lwr4):
    """Times, positions and commanded torques of a true arm over one period, with noise."""
    rng = np.random.default_rng(1)
    motion = draw_excitation(lwr4, ExcitationParameters(period=PERIOD), rng)
    time = PERIOD + np.arange(0.0, PERIOD, 0.005)
    q, v, a = fourier_fit(time, motion.at(time), PERIOD, HARMONICS)
    torque = inverse_dynamics(corrected(lwr4, TRUE).tree, q, v, a) - BIAS
    torque += np.array(TRUE.coulomb) * np.sign(v) + np.array(TRUE.viscous) * v
    return time, q + 1e-5 * rng.standard_normal(q.shape), torque + 0.05 * rng.standard_normal(q.shape)


def test_friction_bias_and_payload_are_found(lwr4, recording):
    result = identify(lwr4, *recording, PERIOD, HARMONICS)
    found = result.found
    np.testing.assert_allclose(found.coulomb, TRUE.coulomb, atol=0.05)
    np.testing.assert_allclose(found.viscous, TRUE.viscous, atol=0.1)
    np.testing.assert_allclose(found.bias, BIAS, atol=0.1)
    assert found.payload == pytest.approx(1.5, abs=0.15)
    q = lwr4.home + 0.3
    weights = [evaluate_dynamics(corrected(lwr4, c), q, np.zeros(7)).g for c in (RobotCorrections(), found, TRUE)]
    assert np.abs(weights[1] - weights[2]).max() < 0.1 * np.abs(weights[0] - weights[2]).max()
    assert np.all(result.after < 0.1) and np.all(result.before > result.after)


def test_a_late_drive_is_found(lwr4, recording):
    """Torques that come two samples after their commands; the wrong delay explains less."""
    time, q, torque = recording
    result = identify(lwr4, time, q, np.roll(torque, -2, axis=0), PERIOD, HARMONICS, [0.0, 0.01, 0.05])
    assert result.delay == 0.01


def test_the_regressor_is_the_torque(lwr4):
    """Of a payload: mass, first moments and inertia about the origin, against the model that has it."""
    rng = np.random.default_rng(3)
    motion = Motion(*(lwr4.home + 0.3 * rng.standard_normal((6, 7)), *rng.standard_normal((2, 6, 7))))
    Y, centre = regressor(lwr4, motion), np.array(TRUE.payload_centre)
    about = TRUE.payload * (np.dot(centre, centre) * np.eye(3) - np.outer(centre, centre))
    theta = np.zeros(45)
    theta[35:] = [1.5, *(1.5 * centre), *np.diag(about), about[0, 1], about[0, 2], about[1, 2]]
    loaded = corrected(lwr4, RobotCorrections(payload=1.5, payload_centre=TRUE.payload_centre))
    more = inverse_dynamics(loaded.tree, *motion) - inverse_dynamics(lwr4.tree, *motion)
    np.testing.assert_allclose(Y @ theta, more, atol=1e-9)
    scaled = np.zeros(45)
    scaled[21:35] = 0.1  # rotors and links: all of the dynamics
    np.testing.assert_allclose(Y @ scaled, 0.1 * inverse_dynamics(lwr4.tree, *motion), atol=1e-9)


def test_bad_data_is_told(lwr4, recording):
    time, q, torque = recording
    with pytest.raises(StateError, match="7 joints"):
        identify(lwr4, time, q[:, :6], torque, PERIOD)
    with pytest.raises(StateError, match="finite"):
        identify(lwr4, time, q, np.where(torque > 1e9, 0.0, np.nan), PERIOD)
