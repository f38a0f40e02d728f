"""The detector: threshold, hysteresis, release time and noise."""

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ContactPoint, SystemStatus
from saphari_drake.safety.contact_detector import ContactDetector, ContactDetectorParameters, residual_noise


def detector(residual=0.0, **params):
    return Bench(ContactDetector(7, ContactDetectorParameters(**params)), torque_external=joint(residual))


def joint(value, index=3):
    """Return a residual that is zero but in one joint."""
    r = np.zeros(7)
    r[index] = value
    return r


@pytest.mark.parametrize("index", range(7))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_contact_from_the_threshold_on_without_delay(index, sign):
    """In any joint, in either direction, in the same cycle."""
    bench = detector(threshold=1.5)
    bench.set(torque_external=joint(sign * 1.499, index))
    assert bench.read("contact") == 0.0
    bench.set(torque_external=joint(sign * 1.5, index))
    assert bench.read("contact") == 1.0


def test_each_joint_has_its_threshold():
    thresholds = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    bench = detector(threshold=thresholds)
    for index, threshold in enumerate(thresholds):
        bench.set(torque_external=joint(0.9 * threshold, index))
        assert bench.read("ratio") == pytest.approx(0.9)
        assert bench.read("contact") == 0.0


def test_stays_between_release_level_and_threshold():
    """Once touched, a residual above the release ratio keeps the contact for any time; untouched, it makes none."""
    bench = detector(threshold=1.0, release_ratio=0.5)
    bench.run(100, torque_external=joint(0.7))
    assert bench.read("contact") == 0.0
    bench.run(torque_external=joint(1.0))
    bench.run(100, torque_external=joint(0.5))
    assert bench.read("contact") == 1.0


def test_what_may_be_friction_releases_unless_somebody_is_seen_there():
    """0.7 Nm of 1 Nm, where friction may be 1 Nm: a hidden touch ends, one that is seen does not."""
    for distance, lasts in ((0.004, 1.0), (0.0, 0.0)):
        bench = detector(threshold=1.0, release_ratio=0.5)
        contact = ContactPoint(found=True, link=3, distance=distance)
        bench.set(torque_uncertainty=np.zeros(7), contact_point=contact)
        bench.run(20, torque_external=joint(2.0))
        bench.run(200, torque_uncertainty=np.ones(7))
        bench.run(100, torque_external=joint(0.7))
        assert bench.read("contact") == lasts
        bench.run(20, contact_point=ContactPoint())
        assert bench.read("contact") == 0.0


@pytest.mark.parametrize("release_time", [0.05, 0.02])
def test_released_after_the_release_time(release_time):
    bench = detector(release_time=release_time)
    bench.run(torque_external=joint(2.0))
    cycles = round(release_time / PERIOD)
    for _ in range(cycles - 1):
        bench.run(torque_external=joint(0.1))
        assert bench.read("contact") == 1.0
    bench.run(2)
    assert bench.read("contact") == 0.0


def test_release_time_starts_again_when_the_residual_rises():
    bench = detector(release_time=0.05)
    bench.run(torque_external=joint(2.0))
    for _ in range(10):
        bench.run(8, torque_external=joint(0.1))
        bench.run(torque_external=joint(0.6))
        assert bench.read("contact") == 1.0
    bench.run(12, torque_external=joint(0.1))
    assert bench.read("contact") == 0.0


def test_no_release_time_releases_in_one_cycle():
    bench = detector(release_time=0.0)
    bench.run(torque_external=joint(2.0))
    bench.set(torque_external=joint(0.0))
    bench.run()
    assert bench.read("contact") == 0.0


def test_noise_raises_the_threshold_to_its_multiple():
    """Never below the given threshold, and joint by joint."""
    noise = joint(0.5)
    bench = detector(threshold=1.0, noise=list(noise), noise_multiple=6.0)
    bench.set(torque_external=joint(2.9))
    assert bench.read("contact") == 0.0
    bench.set(torque_external=joint(3.0))
    assert bench.read("contact") == 1.0
    bench.set(torque_external=joint(1.0, index=0))
    assert bench.read("contact") == 1.0


def test_uncertainty_and_measured_noise_raise_the_threshold():
    """What the model may lack is added; a noise that is measured counts like that of the parameter."""
    bench = detector(threshold=1.0, noise_multiple=5.0)
    bench.set(torque_uncertainty=joint(0.7), torque_external=joint(1.69))
    assert bench.read("contact") == 0.0
    bench.set(torque_external=joint(1.71))
    assert bench.read("contact") == 1.0
    bench = detector(threshold=1.0, noise_multiple=5.0)
    bench.set(torque_noise=joint(0.4), torque_uncertainty=joint(0.5), torque_external=joint(2.49))
    assert bench.read("contact") == 0.0
    bench.set(torque_external=joint(2.51))
    assert bench.read("contact") == 1.0


def test_measured_noise_gives_no_false_contact():
    """Five standard deviations of measured noise: silent over 20000 samples that a bare threshold would not pass."""
    rng = np.random.default_rng(0)
    sigma = np.linspace(0.1, 0.7, 7)
    noise = residual_noise(rng.normal(size=(5000, 7)) * sigma)
    np.testing.assert_allclose(noise, sigma, rtol=0.05)
    samples = rng.normal(size=(20000, 7)) * sigma
    quiet, eager = detector(noise=list(noise)), detector()
    for scale, bench, contact in ((sigma, quiet, 0.0), (np.ones(7), eager, 1.0)):
        bench.set(torque_external=samples[np.argmax(np.max(np.abs(samples) / scale, axis=1))])
        assert bench.read("contact") == contact


def test_lost_residual_is_no_proof_that_nobody_touches():
    """NaN counts as contact: an element of safety fails to the safe side."""
    bench = detector()
    bench.set(torque_external=joint(np.nan))
    assert bench.read("contact") == 1.0 and bench.read("system_status") == SystemStatus.BAD_INPUT
    bench.run()
    bench.set(torque_external=joint(0.0))
    assert bench.read("contact") == 1.0 and bench.read("system_status") == SystemStatus.OK
    bench.run(20)
    assert bench.read("contact") == 0.0


def test_clone_of_the_context_goes_on_by_itself():
    bench = detector()
    bench.run(torque_external=joint(2.0))
    twin = bench.clone()
    bench.run(20, torque_external=joint(0.0))
    assert bench.read("contact") == 0.0
    twin.set(torque_external=joint(0.0))
    assert twin.read("contact") == 1.0
    twin.run(20)
    assert twin.read("contact") == 0.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("threshold", 0.0),
        ("threshold", [1.0, np.nan]),
        ("noise", -0.1),
        ("noise_multiple", 0.0),
        ("release_ratio", 0.0),
        ("release_ratio", 1.0),
        ("release_time", -1.0),
        ("period", 0.0),
    ],
)
def test_bad_parameters(name, value):
    with pytest.raises(ParameterError, match=name):
        ContactDetectorParameters(**{name: value})


def test_threshold_of_the_wrong_size():
    with pytest.raises(ParameterError, match="threshold: needs 1 or 7 entries"):
        ContactDetector(7, ContactDetectorParameters(threshold=[1.0, 1.0]))


def test_a_residual_that_drops_is_released_above_the_release_level():
    bench = detector(6.0)
    bench.run(10)
    bench.run(20, torque_external=joint(0.8))
    assert bench.read("contact") == 0.0


def test_a_weak_touch_shows_in_the_smoothed_residual_of_coarse_encoders():
    """Noise that alternates, as of differentiated encoders: no contact without touch, a weak one within five cycles."""
    rng = np.random.default_rng(0)
    steps = rng.uniform(-1.0, 1.0, (2001, 7))
    noise = 0.8 * np.diff(steps, axis=0)  # Nm; it hides the touch from single samples
    sigma = residual_noise(noise)
    bench, plain = (detector(noise=list(sigma), smoothed_threshold=value) for value in (0.5, np.inf))
    for r in noise[:-40]:
        bench.set(torque_external=r)
        assert bench.read("contact") == 0.0
        bench.run()
    cycles = 0
    for r in noise[-40:]:
        bench.set(torque_external=r + joint(1.2))
        if bench.read("contact") == 1.0:
            break
        bench.run()
        cycles += 1
    assert cycles < 6
    plain.run(6, torque_external=noise[-2] + joint(1.2))
    plain.set(torque_external=noise[-1] + joint(1.2))
    assert plain.read("contact") == 0.0


def test_noise_of_the_smoothed_residual_raises_its_threshold_but_a_steady_lean_does_not():
    rng = np.random.default_rng(1)
    loud, leaning = detector(smoothed_threshold=0.5, threshold=10.0), detector(smoothed_threshold=0.5, threshold=10.0)
    for _ in range(2000):
        loud.run(torque_external=joint(0.5 * rng.normal()))
        leaning.run(torque_external=joint(0.3))
    for bench, contact in ((loud, 0.0), (leaning, 1.0)):
        bench.run(20, torque_external=joint(0.6))
        assert bench.read("contact") == contact


def test_bad_smoothed_threshold():
    with pytest.raises(ParameterError, match="smoothed_threshold"):
        ContactDetectorParameters(smoothed_threshold=0.0)
