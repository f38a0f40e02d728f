"""The controller as a system: ports, state in the Context, clones, faults."""

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.hand_guiding.system import HandGuidingController
from saphari_drake.messages import GuidingPriority, GuidingStatus, SkinContact, SkinReading, SkinStatus
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
        "torque_commanded": 7, "torque_excess": 7, "acceleration_commanded": 7, "position_commanded": 7,
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


@pytest.mark.parametrize("fault", ["lost", "old", "nan wrench", "nan skin"])
def test_a_lost_sensor_never_reaches_the_command_ports(bench, fault):
    lead(bench, 40)
    moving = np.abs(bench.read("velocity_commanded")).max()
    for _ in range(60):
        now = bench.cycles * PERIOD
        wrench, skin = PULLED, SkinReading(stamp=now)
        if fault == "lost":
            skin = SkinReading(status=SkinStatus.LOST, stamp=now)
        elif fault == "old":
            skin = SkinReading(stamp=now - 1.0)
        elif fault == "nan wrench":
            wrench = np.full(6, np.nan)
        else:
            skin = SkinReading((SkinContact(2, np.full(3, np.nan), np.zeros(3), np.ones(3)),), stamp=now)
        bench.run(1, wrench_measured=wrench, skin=skin)
        for name in ("torque_commanded", "acceleration_commanded", "position_commanded", "force"):
            assert np.all(np.isfinite(bench.read(name)))
    assert bench.read("status") == GuidingStatus.SENSOR_LOST
    assert np.abs(bench.read("velocity_commanded")).max() < 0.1 * moving
