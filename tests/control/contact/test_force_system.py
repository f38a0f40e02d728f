"""The force controller as a system: status, desired force, speed stop, and the chain behind it."""

from dataclasses import replace

import numpy as np
import pytest
from bench import Bench
from command_chain import chained
from force_loop import TIP, Q

from saphari_drake.control.contact.force_system import ContactForceController
from saphari_drake.control.contact.gate import ForceStatus
from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.messages import CommandMode, ContactPoint, Interaction, InteractionMode, SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics

HOLD, CONTACT, RETURN, YIELD, STOP = InteractionMode


class Controlled(Bench):
    """A controller with a robot whose state is set by hand."""

    def __init__(self, robot, v=None, **params):
        self.robot, self.v = robot, np.zeros(7) if v is None else v
        self.dynamics = evaluate_dynamics(robot, Q, self.v)
        switch = {name: params.pop(name) for name in ("transition_time",) if name in params}
        controller = ContactForceController(robot, ContactForceControlParameters(**params))
        super().__init__(
            chained(controller, robot, **switch),
            dynamics=self.dynamics,
            interaction=self.mode(HOLD),
            contact_force=np.zeros(3),
            misfit=np.zeros(7),
            unobservable_directions=np.zeros(9),
        )

    def mode(self, mode, link=5):
        known = mode in (CONTACT, RETURN)
        return Interaction(mode, ContactPoint(known, link, TIP) if known else ContactPoint(), Q, 0)

    @property
    def status(self):
        return ForceStatus(int(self.read("force_status")))


STRONG = np.array([0.0, -8.0, 1.0])


@pytest.mark.parametrize(
    ("mode", "force", "status"),
    [
        (HOLD, STRONG, ForceStatus.HOLD),
        (CONTACT, STRONG, ForceStatus.CONTROLLED),
        (CONTACT, 0.1 * STRONG, ForceStatus.WEAK),
        (RETURN, STRONG, ForceStatus.RELEASED),
        (YIELD, STRONG, ForceStatus.UNSEEN),
        (STOP, STRONG, ForceStatus.NO_CAMERA),
    ],
)
def test_status_says_what_is_done_and_why(lwr4, mode, force, status):
    """No force is desired in any state but the controlled one, and at rest nothing moves but by the person."""
    bench = Controlled(lwr4)
    bench.run(interaction=bench.mode(mode), contact_force=force)
    assert bench.status == status
    if status != ForceStatus.CONTROLLED:
        np.testing.assert_array_equal(bench.read("desired_force"), 0.0)
        np.testing.assert_array_equal(bench.read("force_error"), 0.0)
        np.testing.assert_allclose(bench.read("torque_applied"), bench.dynamics.g, atol=1e-9)


def test_desired_force_is_aligned_and_grows_to_its_size(lwr4):
    bench = Controlled(lwr4)
    F = 13.0 * STRONG / np.linalg.norm(STRONG)
    bench.run(60, interaction=bench.mode(CONTACT), contact_force=F)
    np.testing.assert_allclose(bench.read("desired_force"), 15.0 * F / 13.0, atol=1e-9)
    np.testing.assert_allclose(bench.read("force_error"), F - 15.0 * F / 13.0, atol=1e-9)


def test_friction_that_looks_like_a_tangential_force_does_not_turn_the_desired_one(lwr4):
    """However far the estimate leans, the arm presses where the surface can be pressed."""
    bench = Controlled(lwr4)
    inward = np.array([0.0, -1.0, 0.0])
    point = ContactPoint(True, 5, TIP, -bench.dynamics.R_WL[5].T @ inward)
    interaction = replace(bench.mode(CONTACT), contact=point)
    bench.run(200, interaction=interaction, contact_force=np.array([12.0, -9.0, 0.0]))
    F_d = bench.read("desired_force")
    np.testing.assert_allclose(F_d, 15.0 * np.array([0.25, -1.0, 0.0]) / np.hypot(1.0, 0.25), atol=1e-9)


def test_only_observable_directions_are_asked_for(lwr4):
    """With a hidden direction the status is PARTIAL, and a fixed force loses its part along it."""
    bench, hidden = Controlled(lwr4, direction="fixed", fixed_force=[3.0, 15.0, -2.0]), np.array([0.0, 0.6, 0.8])
    columns = np.concatenate([hidden, np.zeros(6)])
    bench.run(interaction=bench.mode(CONTACT), contact_force=STRONG, unobservable_directions=columns)
    wanted = np.array([3.0, 15.0, -2.0])
    assert bench.status == ForceStatus.PARTIAL
    np.testing.assert_allclose(bench.read("desired_force"), wanted - hidden * (hidden @ wanted))


def test_speed_stop_says_why_and_brakes(lwr4):
    """A contact that is too fast is braked in the same cycle, with the velocity that was foreseen on a port."""
    J = evaluate_dynamics(lwr4, Q, np.zeros(7)).point(5, TIP).Jv_WC
    v = np.linalg.pinv(J) @ np.array([0.0, 0.22, 0.0])
    bench = Controlled(lwr4, v, direction="fixed", fixed_force=[0.0, -15.0, 0.0], transition_time=1e-4)
    bench.run(5, interaction=bench.mode(CONTACT), contact_force=STRONG)
    assert bench.status == ForceStatus.SPEED_STOP
    assert bench.read("stop_velocity")[1] > 0.25
    np.testing.assert_array_equal(bench.read("desired_force"), 0.0)
    bench.run(30)
    d = bench.dynamics
    np.testing.assert_allclose(bench.read("torque_applied"), d.M @ (-30.0 * v) + d.Cv + d.g, atol=1e-3)
    bench.run(interaction=bench.mode(RETURN))
    np.testing.assert_array_equal(bench.read("stop_velocity"), 0.0)
    assert bench.status == ForceStatus.RELEASED


@pytest.mark.parametrize("fade", [0.005, 0.1])
@pytest.mark.parametrize("M_d", [[], [3.0, 3.0, 3.0], [10.0, 10.0, 10.0]], ids=["natural", "light", "heavy"])
def test_drift_never_exceeds_the_speed_limit(lwr4, M_d, fade):
    """Nobody resists 15 N along Y: the arm in the loop is stopped below 0.25 m/s and brakes, however light it is."""
    bench = Controlled(lwr4, direction="fixed", M_d=M_d, transition_time=fade)
    q, v, F, speeds = Q.copy(), np.zeros(7), np.array([3.5, 0.0, 0.0]), []
    for _ in range(160):
        terms = evaluate_dynamics(lwr4, q, v)
        bench.run(dynamics=terms, interaction=bench.mode(CONTACT), contact_force=F)
        torque = bench.read("torque_applied")
        for _ in range(5):
            terms = evaluate_dynamics(lwr4, q, v)
            point = terms.point(5, TIP)
            v = v + 0.001 * np.linalg.solve(terms.M, torque - terms.Cv - terms.g + point.Jv_WC.T @ F)
            q = q + 0.001 * v
            speeds.append(np.linalg.norm(point.v_WC))
    assert bench.status == ForceStatus.SPEED_STOP
    assert 0.03 < max(speeds) <= 0.25
    assert bench.read("stop_velocity")[1] < 0.0


@pytest.mark.parametrize("after", InteractionMode)
@pytest.mark.parametrize("before", InteractionMode)
def test_change_of_law_makes_no_jump_and_fades(lwr4, before, after):
    v = 0.02 * np.arange(7)
    bench, alone = Controlled(lwr4, v, transition_time=0.03), Controlled(lwr4, v, transition_time=0.03)
    bench.run(3, interaction=bench.mode(before), contact_force=STRONG)
    torque = bench.read("torque_applied")
    bench.run()
    bench.set(interaction=bench.mode(after))
    if before != after:
        np.testing.assert_allclose(bench.read("torque_applied"), torque, atol=1e-9)
    bench.run(120)
    alone.run(120, interaction=alone.mode(after), contact_force=STRONG)
    np.testing.assert_allclose(bench.read("torque_applied"), alone.read("torque_applied"), atol=1e-4)


def test_gate_makes_no_jump(lwr4):
    bench = Controlled(lwr4, leave_time=0.0)
    bench.run(3, interaction=bench.mode(CONTACT), contact_force=0.3 * STRONG)
    for force in (STRONG, 0.1 * STRONG, STRONG):
        torque = bench.read("torque_applied")
        bench.run()
        bench.set(contact_force=force)
        np.testing.assert_allclose(bench.read("torque_applied"), torque, atol=1e-9)
        bench.run(4)


def test_torque_is_limited_last(lwr4):
    bench = Controlled(lwr4, direction="fixed", fixed_force=[0.0, 9000.0, 0.0], speed_limit=1e3)
    bench.run(200, interaction=bench.mode(CONTACT), contact_force=STRONG)
    torque, excess = bench.read("torque_applied"), bench.read("torque_excess")
    assert np.all(np.abs(torque) <= lwr4.tau_max) and np.any(excess != 0.0)
    terms = bench.read("torque_terms").reshape(-1, 7).sum(axis=0)
    np.testing.assert_allclose(terms + bench.read("transition"), torque + excess)


@pytest.mark.parametrize("cycles", [1, 50])
def test_a_force_that_is_not_a_number_closes_the_gate(lwr4, cycles):
    """Braking needs no force; it is controlled again when it is known."""
    bench = Controlled(lwr4)
    bench.run(20, interaction=bench.mode(CONTACT), contact_force=STRONG)
    bench.run(cycles, contact_force=np.full(3, np.nan), misfit=np.full(7, np.nan))
    assert bench.status == ForceStatus.WEAK and bench.read("selection").mode == CommandMode.BRAKE
    assert np.isfinite(bench.read("torque_applied")).all()
    bench.run(contact_force=STRONG, misfit=np.zeros(7))
    assert bench.status == ForceStatus.CONTROLLED


@pytest.mark.parametrize("port", ["misfit", "dynamics"])
def test_a_misfit_or_state_that_is_not_known_makes_no_command_and_keeps_the_gate(lwr4, port):
    """A speed stop is not forgotten for it."""
    J = evaluate_dynamics(lwr4, Q, np.zeros(7)).point(5, TIP).Jv_WC
    bench = Controlled(lwr4, np.linalg.pinv(J) @ np.array([0.0, 0.3, 0.0]))
    bad = {"misfit": np.full(7, np.inf), "dynamics": bench.dynamics.unknown()}[port]
    bench.run(interaction=bench.mode(CONTACT), contact_force=STRONG)
    assert bench.status == ForceStatus.SPEED_STOP
    slow = evaluate_dynamics(lwr4, Q, np.zeros(7))
    bench.run(10, **{"dynamics": slow, port: bad})
    status = SystemStatus.BAD_INPUT if port == "dynamics" else SystemStatus.OK  # braking needs no misfit
    assert bench.read("system_status") == status and np.isfinite(bench.read("torque_applied")).all()
    bench.run(misfit=np.zeros(7), dynamics=slow)
    assert bench.status == ForceStatus.SPEED_STOP
    bench.run(interaction=bench.mode(RETURN))
    bench.run(interaction=bench.mode(CONTACT))
    assert bench.status == ForceStatus.CONTROLLED
    bench.set(**{port: bad})
    assert bench.read("system_status") == SystemStatus.BAD_INPUT
    assert np.isfinite(bench.read("torque_applied")).all()


def test_a_clone_goes_its_own_way(lwr4):
    """Gate, ramp and fading torque live in the Context."""
    bench = Controlled(lwr4)
    bench.run(20, interaction=bench.mode(CONTACT), contact_force=STRONG)
    twin = bench.clone()
    names = ("torque_terms", "desired_force", "force_status")
    for _ in range(3):
        bench.run(10)
        twin.run(10)
        for name in names:
            np.testing.assert_array_equal(bench.read(name), twin.read(name))
    twin.run(10, interaction=bench.mode(STOP))
    assert bench.status == ForceStatus.CONTROLLED and twin.read("force_status") == ForceStatus.NO_CAMERA
