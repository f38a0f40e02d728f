"""A wrist sensor that tells of another force than the joints feel is not believed."""

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.estimation.wrench_check import WrenchCheck, WrenchCheckParameters, WrenchCheckStatus
from saphari_drake.messages import SkinContact, SkinReading
from saphari_drake.robots.dynamics import evaluate_dynamics

FORCE = np.array([4.0, -6.0, 8.0])


class Felt:
    """A force that changes slowly, as the wrist and the observer tell of it."""

    def __init__(self, robot):
        self.robot = robot
        self.terms = evaluate_dynamics(robot, robot.home, np.zeros(7))
        self.J = self.terms.point(6, np.zeros(3)).Jv_WC
        self.share, self.lagged = -np.expm1(-50.0 * PERIOD), np.zeros(7)
        system = WrenchCheck(robot, WrenchCheckParameters(period=PERIOD))
        self.bench = Bench(
            system, dynamics=self.terms, wrench_measured=np.zeros(6), skin=SkinReading(), torque_external=np.zeros(7)
        )
        self.time = 0.0

    def run(self, cycles, bias=0.0, error=0.0, skin=0.0):
        """Let both feel the force, the wrist `bias` (N) more, the model `error` (Nm); the skin another force (N)."""
        statuses = []
        contact = SkinContact(3, np.array([0.05, 0.0, 0.1]), np.array([1.0, 0.0, 0.0]), np.array([-skin, 0.0, 0.0]))
        pressed = self.terms.point(3, contact.p_LC).Jv_WC.T @ (self.terms.R_WL[3] @ contact.f_L)
        for _ in range(cycles):
            force = FORCE * np.sin(6.0 * self.time)
            self.lagged += self.share * (self.J.T @ force + pressed - self.lagged)
            self.bench.run(
                1,
                wrench_measured=np.r_[np.zeros(3), force + bias],
                torque_external=self.lagged + error,
                skin=SkinReading((contact,)) if skin else SkinReading(),
            )
            self.time += PERIOD
            statuses.append(int(self.bench.read("status")))
        return statuses


@pytest.fixture
def felt(lwr4):
    return Felt(lwr4)


def test_what_both_feel_is_passed_on(felt):
    """A hand at the tip, then one at the skin as well, while the model's error grows by 2 Nm in a second."""
    statuses = felt.run(100)
    for k in range(200):
        statuses += felt.run(1, error=0.01 * k, skin=20.0 if k > 100 else 0.0)
    assert set(statuses) == {WrenchCheckStatus.OK}
    assert np.isfinite(felt.bench.read("wrench_checked")).all()


def test_friction_of_a_joint_that_gets_fast_and_stops_is_no_fault(felt):
    """1 Nms/rad that nobody has identified, up to 3 rad/s within 0.6 s; a force of the same size at rest is one."""
    still = felt.terms
    for speed in [0.0] * 50 + [*np.linspace(0.0, 3.0, 120), *np.linspace(3.0, 0.0, 40)]:
        v = np.r_[np.zeros(5), speed, 0.0]
        felt.bench.set(dynamics=evaluate_dynamics(felt.robot, felt.robot.home, v))
        assert felt.run(1, error=-v) == [WrenchCheckStatus.OK]
    felt.bench.set(dynamics=still)
    felt.run(1000)
    assert felt.run(20, error=np.r_[np.zeros(5), -3.0, 0.0])[-1] == WrenchCheckStatus.DOUBTED


def test_a_bias_is_told_within_a_tenth_of_a_second_and_for_good(felt):
    felt.run(100)
    statuses = felt.run(400, bias=np.array([5.0, -5.0, 5.0]))
    assert statuses.index(WrenchCheckStatus.DOUBTED) * PERIOD < 0.1
    assert statuses[-1] == WrenchCheckStatus.DOUBTED and np.isnan(felt.bench.read("wrench_checked")).all()
    assert felt.run(150)[-1] == WrenchCheckStatus.OK


def test_a_hand_that_no_sensor_feels_is_doubted(felt):
    felt.run(50)
    assert felt.run(40, error=5.0)[-1] == WrenchCheckStatus.DOUBTED


@pytest.mark.parametrize("port", ["wrench_measured", "torque_external"])
def test_what_is_not_known_is_passed_on_and_teaches_nothing(felt, port):
    felt.run(50)
    felt.bench.run(20, **{port: np.full(7 if port == "torque_external" else 6, np.nan)})
    assert felt.bench.read("status") == WrenchCheckStatus.OK
    assert np.isnan(felt.bench.read("wrench_checked")).all() == (port == "wrench_measured")
    assert set(felt.run(50)) == {WrenchCheckStatus.OK}


def test_a_clone_goes_on_as_the_original(felt):
    felt.run(20)
    other = felt.bench.clone()
    for bench in (felt.bench, other):
        bench.run(15, torque_external=np.full(7, 9.0))
    assert felt.bench.read("status") == other.read("status") == WrenchCheckStatus.DOUBTED
