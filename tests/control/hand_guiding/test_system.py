"""The controller as a system: ports, state in the Context, clones, faults."""

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.hand_guiding.system import HandGuidingController
from saphari_drake.control.hand_guiding.touch import GuidingPriority, GuidingStatus
from saphari_drake.messages import SkinContact, SkinReading, SkinStatus, SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics

HOME = np.deg2rad([90.0, -35.0, 0.0, 68.0, 0.0, -45.0, 0.0])
STILL = np.zeros(6)
PULLED = np.array([0.0, 0.0, 0.0, 5.0, 0.0, 0.0])


def pressed(time):
    contact = SkinContact(2, np.array([0.0, 0.065, 0.1]), np.array([0.0, 1.0, 0.0]), np.array([1.0, -6.0, 1.0]))
    return SkinReading((contact,), stamp=time)


@pytest.fixture
def bench(lwr4):
    controller = HandGuidingController(lwr4, HandGuidingParameters(period=PERIOD))
    terms = evaluate_dynamics(lwr4, HOME, np.zeros(7))
    result = Bench(controller, dynamics=terms, skin=SkinReading(stamp=0.0), wrench_measured=STILL)
    result.run(2, skin=SkinReading(stamp=0.0))
    return result


def lead(bench, cycles, wrench=PULLED, skin=False):
    """Run cycles with fresh readings of the skin."""
    for _ in range(cycles):
        now = bench.cycles * PERIOD
        bench.run(1, wrench_measured=wrench, skin=pressed(now) if skin else SkinReading(stamp=now))


def test_ports_have_the_sizes_they_state(bench):
    sizes = {
        "torque_commanded": 7, "system_status": 1, "acceleration_commanded": 7, "position_commanded": 7,
        "velocity_commanded": 7, "force": 6, "point_position": 6, "velocity_desired": 6, "acceleration_desired": 6,
        "rank": 2, "unreachable_force": 2, "unreachable_direction": 6, "priority": 1, "status": 1,
    }  # fmt: skip
    system = bench.system
    assert {system.get_output_port(i).get_name() for i in range(system.num_output_ports())} == set(sizes)
    for name, size in sizes.items():
        assert system.GetOutputPort(name).size() == size


def test_it_starts_where_the_arm_is_and_carries_it(bench, lwr4):
    """At rest with nobody touching, the torque is gravity, and the commanded position the measured one."""
    terms = evaluate_dynamics(lwr4, HOME, np.zeros(7))
    np.testing.assert_allclose(bench.read("torque_commanded"), terms.g, atol=1e-9)
    np.testing.assert_allclose(bench.read("position_commanded"), HOME, atol=1e-12)
    assert bench.read("status") == GuidingStatus.HOLD


def test_without_a_skin_the_tip_is_guided(lwr4):
    """The port is left open; as long as it lasts."""
    controller = HandGuidingController(lwr4, HandGuidingParameters(period=PERIOD))
    terms = evaluate_dynamics(lwr4, HOME, np.zeros(7))
    bench = Bench(controller, dynamics=terms, wrench_measured=STILL)
    bench.run(40)
    assert bench.read("status") == GuidingStatus.HOLD
    bench.run(20, wrench_measured=PULLED)
    assert (bench.read("status"), bench.read("priority")) == (GuidingStatus.GUIDED, GuidingPriority.END_EFFECTOR)


def test_forces_are_answered_in_the_torque_and_told(bench, lwr4):
    """At the onset of a touch from rest: τ = g − J_eᵀF_e − J_bᵀF_b, and priority and status say who leads."""
    lead(bench, 1, skin=True)
    terms = evaluate_dynamics(lwr4, HOME, np.zeros(7))
    reading = pressed(0.0).contacts[0]
    expected = terms.g - terms.point(6, np.zeros(3)).Jv_WC.T @ PULLED[3:]
    expected = expected - terms.point(2, reading.p_LC).Jv_WC.T @ (terms.R_WL[2] @ reading.f_L)
    a = bench.read("acceleration_commanded")
    np.testing.assert_allclose(bench.read("torque_commanded") - terms.M @ a, expected, atol=1e-2)
    assert bench.read("priority") == GuidingPriority.BODY  # pressed harder
    np.testing.assert_allclose(bench.read("force")[:3], PULLED[3:])


def test_coriolis_torque_is_an_option(lwr4):
    """With and without it, the torque differs by C q̇."""
    terms = evaluate_dynamics(lwr4, HOME, np.full(7, 0.5))
    torques = []
    for coriolis in (True, False):
        controller = HandGuidingController(lwr4, HandGuidingParameters(period=PERIOD, coriolis=coriolis))
        bench = Bench(controller, dynamics=terms, skin=SkinReading(stamp=0.0), wrench_measured=STILL)
        torques.append(bench.read("torque_commanded"))
    np.testing.assert_allclose(torques[0] - torques[1], terms.Cv, atol=1e-9)


def test_a_clone_goes_on_by_itself(bench):
    """The state is in the Context: two copies with different hands part ways, with the same hands they do not."""
    lead(bench, 20)
    other, twin = bench.clone(), bench.clone()
    lead(bench, 10)
    lead(other, 10, wrench=STILL)
    lead(twin, 10)
    np.testing.assert_array_equal(bench.read("velocity_commanded"), twin.read("velocity_commanded"))
    assert np.abs(bench.read("velocity_commanded") - other.read("velocity_commanded")).max() > 1e-3


def contact(link=2, p=(0.0, 0.065, 0.1), f=(1.0, -6.0, 1.0)):
    return (SkinContact(link, np.array(p), np.array([0.0, 1.0, 0.0]), np.array(f)),)


@pytest.mark.parametrize("lasting", [False, True])
@pytest.mark.parametrize(
    "fault",
    [
        lambda now: {"skin": SkinReading(status=SkinStatus.LOST, stamp=now)},
        lambda now: {"skin": SkinReading(stamp=now - 1.0)},
        lambda now: {"skin": SkinReading(stamp=np.nan)},
        lambda now: {"skin": SkinReading(contact(f=(np.nan, 0.0, 0.0)), stamp=now)},
        lambda now: {"skin": SkinReading(contact(p=(np.inf, 0.0, 0.0)), stamp=now)},
        lambda now: {"skin": SkinReading(contact(f=(1.0, 2.0)), stamp=now)},
        lambda now: {"skin": SkinReading(contact(link=7), stamp=now)},
        lambda now: {"skin": SkinReading(stamp=now), "wrench_measured": np.full(6, np.nan)},
        lambda now: {"skin": SkinReading(stamp=now), "wrench_measured": np.full(6, np.inf)},
    ],
    ids=["lost", "old", "no time", "nan force", "inf point", "wrong size", "no such link", "nan wrench", "inf wrench"],
)
def test_a_force_that_is_not_known_brakes_and_never_reaches_the_commands(bench, fault, lasting):
    """Told by both statuses while it lasts; then it waits until the hand lets go, and is led again."""
    lead(bench, 40)
    moving = np.abs(bench.read("velocity_commanded")).max()
    for _ in range(60 if lasting else 3):
        bench.run(1, wrench_measured=PULLED)
        bench.run(1, **fault(bench.cycles * PERIOD))
        for name in ("torque_commanded", "acceleration_commanded", "position_commanded", "force"):
            assert np.all(np.isfinite(bench.read(name)))
        assert bench.read("status") == GuidingStatus.SENSOR_LOST
        assert bench.read("system_status") == SystemStatus.BAD_INPUT
    if lasting:
        assert np.abs(bench.read("velocity_commanded")).max() < 0.1 * moving
    lead(bench, 1)
    assert bench.read("status") == GuidingStatus.WAITING and bench.read("system_status") == SystemStatus.OK
    lead(bench, 2, STILL)
    lead(bench, 20)
    assert bench.read("status") == GuidingStatus.GUIDED


@pytest.mark.parametrize("feedback", ["measured", "commanded"])
@pytest.mark.parametrize("cycles", [10, 40])
def test_a_joint_state_that_is_not_known(lwr4, feedback, cycles):
    """Torque is not known either. What follows the measured motion starts anew where the arm is then, at rest; an arm
    that takes positions is braked along the commanded motion meanwhile."""
    home = lwr4.with_home(HOME)
    controller = HandGuidingController(home, HandGuidingParameters(period=PERIOD, feedback=feedback))
    terms = evaluate_dynamics(lwr4, HOME, np.zeros(7))
    bench = Bench(controller, dynamics=terms, skin=SkinReading(stamp=0.0), wrench_measured=STILL)
    lead(bench, 2, STILL)
    lead(bench, 40)
    commanded, moving = bench.read("position_commanded"), np.abs(bench.read("velocity_commanded")).max()
    bench.set(dynamics=terms.unknown())
    lead(bench, cycles)
    assert bench.read("status") == GuidingStatus.SENSOR_LOST
    assert bench.read("system_status") == SystemStatus.BAD_INPUT
    assert np.isnan(bench.read("torque_commanded")).all()
    if feedback == "commanded":
        assert np.abs(bench.read("velocity_commanded")).max() < moving
        assert 0.0 < np.abs(bench.read("position_commanded") - commanded).max() < 0.1
    else:
        assert np.isnan(bench.read("position_commanded")).all()
    elsewhere = evaluate_dynamics(lwr4, HOME + 0.3, np.full(7, 0.2))
    bench.set(dynamics=elsewhere)
    assert bench.read("status") == GuidingStatus.WAITING
    if feedback == "measured":
        np.testing.assert_allclose(bench.read("position_commanded"), HOME + 0.3, atol=1e-12)
        np.testing.assert_allclose(bench.read("velocity_commanded"), 0.0)
    lead(bench, 2, STILL)
    lead(bench, 20)
    assert np.isfinite(bench.read("torque_commanded")).all() and bench.read("system_status") == SystemStatus.OK
    assert bench.read("priority") == GuidingPriority.END_EFFECTOR
    # The workspace stays where it was.
    np.testing.assert_array_equal(bench.context.get_abstract_state(0).get_value().q_start, HOME)


def test_a_start_without_a_joint_state_is_a_start_later(lwr4):
    """Nothing is known before; the posture held then is the first one that is."""
    controller = HandGuidingController(lwr4, HandGuidingParameters(period=PERIOD))
    terms = evaluate_dynamics(lwr4, HOME, np.zeros(7))
    bench = Bench(controller, dynamics=terms.unknown(), skin=SkinReading(stamp=0.0), wrench_measured=STILL)
    lead(bench, 3, STILL)
    assert np.isnan(bench.read("torque_commanded")).all()
    bench.set(dynamics=terms)
    lead(bench, 2, STILL)
    np.testing.assert_allclose(bench.read("torque_commanded"), terms.g, atol=1e-9)
    assert bench.read("status") == GuidingStatus.HOLD
