"""The estimator: when it learns, what it corrects, and what it says of its uncertainty."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.model_error import LearningStatus, ModelErrorEstimator, ModelErrorParameters
from saphari_drake.messages import SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics

BIAS = np.array([0.0, -3.0, 0.0, 1.0, 0.0, 0.1, 0.0])
GAIN = 50.0


class Estimator(Bench):
    """An estimator fed with residuals that lag behind a constant torque as the observer's do."""

    def __init__(self, robot, **params):
        self.robot, self.r = robot, np.zeros(7)
        self.at = lambda bent=0.0, speed=0.0: evaluate_dynamics(robot, robot.home + bent, np.full(7, speed))
        system = ModelErrorEstimator(robot, ModelErrorParameters(**params), GAIN)
        super().__init__(system, dynamics=self.at(), torque_external=self.r, contact=0.0)

    def feel(self, torque, cycles):
        for _ in range(cycles):
            self.run()
            self.r = self.r + (1.0 - np.exp(-GAIN * 0.005)) * (torque - self.r)
            self.set(torque_external=self.r)


def test_a_constant_error_is_learned_at_once_and_carried_by_gravity(lwr4):
    bench = Estimator(lwr4)
    before = bench.read("torque_uncertainty")
    bench.feel(BIAS, 40)
    np.testing.assert_allclose(bench.read("torque_external"), 0.0, atol=0.05)
    np.testing.assert_allclose(bench.read("model_torque"), -BIAS, atol=0.05)
    np.testing.assert_allclose(bench.read("dynamics").g - bench.at().g, -BIAS, atol=0.05)
    assert bench.read("learning_status") == LearningStatus.LEARNING
    after = bench.read("torque_uncertainty")
    assert np.all(before[[1, 3]] > 2.0) and np.all(after < 0.2)


def test_the_uncertainty_grows_on_the_way_to_another_posture(lwr4):
    bench = Estimator(lwr4)
    bench.feel(BIAS, 200)
    here = bench.read("torque_uncertainty")
    bench.set(dynamics=bench.at(0.5))
    assert np.max(bench.read("torque_uncertainty") - here) > 0.3


def test_a_joint_that_has_moved_is_unsure_of_its_friction_until_it_has_learned_anew(lwr4):
    bench = Estimator(lwr4, mass=0.0, tool_mass=0.0)
    bench.feel(np.full(7, 0.2), 200)
    here = bench.read("torque_uncertainty")
    bench.set(dynamics=bench.at(0.0009), contact=1.0)
    bench.feel(np.full(7, 0.2), 2)
    np.testing.assert_array_equal(bench.read("torque_uncertainty"), here)
    for bent in (0.03, 0.06, 0.0):
        bench.set(dynamics=bench.at(bent))
        bench.feel(np.full(7, 0.2), 2)
    assert np.all(bench.read("torque_uncertainty") > 0.85) and np.all(here < 0.2)
    bench.set(dynamics=bench.at(0.0), contact=0.0)
    bench.feel(np.full(7, -0.2), 100)
    assert np.all(bench.read("torque_uncertainty") < 0.5)
    np.testing.assert_allclose(bench.read("torque_external"), 0.0, atol=0.1)


def test_friction_that_nobody_knows_may_grow_with_speed(lwr4):
    bench = Estimator(lwr4)
    bench.feel(0.0 * BIAS, 200)
    here = bench.read("torque_uncertainty")
    bench.set(dynamics=bench.at(0.0, 0.05))
    assert np.all(bench.read("torque_uncertainty") - here > 0.049)


def test_touched_it_learns_nothing(lwr4):
    """Neither while a contact is felt, nor for a moment after, nor while one is suspected."""
    bench = Estimator(lwr4)
    bench.feel(BIAS, 200)
    learned = bench.read("model_torque")
    bench.set(contact=1.0)
    bench.feel(BIAS + 2.0, 100)
    np.testing.assert_array_equal(bench.read("model_torque"), learned)
    assert bench.read("learning_status") == LearningStatus.TOUCHED
    bench.set(contact=0.0)
    bench.feel(BIAS + 0.8, 400)
    np.testing.assert_array_equal(bench.read("model_torque"), learned)
    bench.feel(BIAS, 20)
    np.testing.assert_array_equal(bench.read("model_torque"), learned)
    bench.feel(BIAS, 60)
    assert bench.read("learning_status") == LearningStatus.LEARNING


def test_a_light_touch_is_learned_slowly(lwr4):
    """0.3 Nm that nobody would take for a contact: a tenth of it in the first second or two."""
    bench = Estimator(lwr4)
    bench.feel(BIAS, 200)
    bench.feel(BIAS + 0.3, 300)
    assert np.all(bench.read("torque_external") > 0.25)


def test_while_it_moves_it_learns_nothing(lwr4):
    bench = Estimator(lwr4)
    bench.set(dynamics=bench.at(0.0, 0.3))
    bench.feel(BIAS, 100)
    np.testing.assert_array_equal(bench.read("model_torque"), 0.0)
    assert bench.read("learning_status") == LearningStatus.MOVING


def test_a_robot_that_is_not_the_one_described_is_told(lwr4):
    bench = Estimator(lwr4)
    bench.feel(np.full(7, 60.0), 60)
    assert bench.read("learning_status") == LearningStatus.LIMITED


def test_noise_is_measured_and_steps_are_none(lwr4):
    bench, rng = Estimator(lwr4), np.random.default_rng(0)
    r, keep = np.zeros(7), np.exp(-GAIN * 0.005)
    for _ in range(2000):
        bench.run()
        r = keep * r + np.sqrt(1.0 - keep**2) * 0.2 * rng.normal(size=7)
        bench.set(torque_external=r)
    np.testing.assert_allclose(bench.read("torque_noise"), 0.2, rtol=0.25)


def test_without_a_prior_everything_passes(lwr4):
    bench = Estimator(lwr4, mass=0.0, tool_mass=0.0, offset=0.0)
    bench.feel(BIAS, 100)
    np.testing.assert_array_equal(bench.read("torque_external"), bench.r)
    np.testing.assert_array_equal(bench.read("dynamics").g, bench.at().g)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_inputs_that_are_not_finite_are_told_and_teach_nothing(lwr4, bad):
    bench = Estimator(lwr4)
    bench.feel(BIAS, 100)
    learned = bench.read("model_torque")
    bench.run(3, torque_external=np.full(7, bad))
    assert bench.read("system_status") == SystemStatus.BAD_INPUT
    bench.set(torque_external=np.zeros(7), dynamics=bench.at().unknown())
    assert bench.read("system_status") == SystemStatus.BAD_INPUT and not bench.read("dynamics").finite
    bench.run(3)
    bench.set(dynamics=bench.at())
    bench.r = np.zeros(7)
    bench.feel(BIAS, 100)
    np.testing.assert_allclose(bench.read("model_torque"), learned, atol=0.05)
    np.testing.assert_allclose(bench.read("torque_external"), 0.0, atol=0.05)


def test_a_clone_goes_its_own_way(lwr4):
    bench = Estimator(lwr4)
    bench.feel(BIAS, 50)
    twin, learned = bench.clone(), bench.read("model_torque")
    bench.feel(BIAS + 0.2, 50)
    np.testing.assert_array_equal(twin.read("model_torque"), learned)


@pytest.mark.parametrize(
    ("name", "value"), [("mass", -0.1), ("tool_mass", np.nan), ("noise", 0.0), ("drift_time", np.inf), ("period", 0.0)]
)
def test_bad_parameters(name, value):
    with pytest.raises(ParameterError, match=name):
        ModelErrorParameters(**{name: value})
