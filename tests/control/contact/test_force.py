"""Force control of a contact: its closed loop, gate, unobservable directions, speed stop and changes of law."""

import numpy as np
import pytest
from bench import PERIOD, Bench
from experiments.contact.force_judge import free_drift_speed
from force_loop import RCOND, TIP, Q, gains_of, simulate, spring
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from saphari_drake.control.contact.force import ContactForceController, contact_force_torque, observable_part
from saphari_drake.control.contact.force_parameters import ContactForceControlParameters
from saphari_drake.control.contact.gate import ForceGate
from saphari_drake.control.contact.terms import TorqueTerms, posture_torque
from saphari_drake.errors import ParameterError, StateError
from saphari_drake.estimation.contact_force import estimate_contact_force
from saphari_drake.math.task_space import consistent_inverse
from saphari_drake.messages import ContactPoint, ForceStatus, Interaction, InteractionMode
from saphari_drake.robots.dynamics import evaluate_dynamics

HOLD, CONTACT, RETURN, YIELD, STOP = InteractionMode
MAX_MASS = ContactForceControlParameters().max_effective_mass
INERTIAS = [pytest.param([], id="natural"), pytest.param([10.0, 8.0, 12.0], id="chosen")]


def contacts(robot, links, count=60, seed=0):
    """Random states and points of links, with a force and a desired force."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        terms = evaluate_dynamics(robot, rng.uniform(robot.q_min, robot.q_max), rng.uniform(-1, 1, robot.n))
        point = terms.point(int(rng.choice(links)), np.append(rng.uniform(-0.06, 0.06, 2), rng.uniform(0.0, 0.2)))
        yield terms, point, rng.uniform(-20.0, 20.0, 3), rng.uniform(-20.0, 20.0, 3)


def mobility(terms, point):
    return point.Jv_WC @ np.linalg.solve(terms.M, point.Jv_WC.T)


def contact_acceleration(terms, point, torque, F):
    vdot = np.linalg.solve(terms.M, torque - terms.Cv - terms.g + point.Jv_WC.T @ F)
    return point.Jv_WC @ vdot + point.Jdotv_WC


# ---- the law -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("M_d", INERTIAS)
def test_closed_loop(lwr4, M_d):
    """M_d ẍ + K_d ẋ = K_f (F − F_d) for an exact F̂, with M_d = Λ for the natural inertia."""
    gains, tested = gains_of(lwr4, M_d=M_d, K_f=[4.1, 3.0, 2.0], K_d=[10.5, 20.0, 5.0]), 0
    for terms, point, F, F_d in contacts(lwr4, [3, 4, 5, 6], 100):
        if np.linalg.eigvalsh(mobility(terms, point))[0] < 1.0 / MAX_MASS:
            continue
        parts, commanded = contact_force_torque(terms, point, F, F_d, np.zeros(7), gains)
        a = contact_acceleration(terms, point, parts.total(), F)
        mass = np.diag(M_d) if M_d else consistent_inverse(point.Jv_WC, terms.M, MAX_MASS).Lambda
        np.testing.assert_allclose(mass @ a + gains.K_d @ point.v_WC, gains.K_f @ (F - F_d), atol=1e-7)
        np.testing.assert_allclose(commanded, a, atol=1e-7)
        tested += 1
    assert tested > 60


@pytest.mark.parametrize("M_d", INERTIAS)
@pytest.mark.parametrize("link", [0, 1, 2])
def test_where_a_point_cannot_move_there_is_no_torque(lwr4, link, M_d):
    """On links 1 to 3 a desired force in unobservable directions changes nothing."""
    gains = gains_of(lwr4, M_d=M_d)
    for terms, point, F, F_d in contacts(lwr4, [link]):
        estimate = estimate_contact_force(point.Jv_WC, point.Jv_WC.T @ F, RCOND)
        hidden = estimate.unobservable
        assert estimate.rank < 3
        kept = observable_part(F_d, hidden)
        np.testing.assert_allclose(hidden.T @ kept, 0.0, atol=1e-12)
        if np.linalg.norm(point.Jv_WC.T @ hidden) > 1e-9:
            continue
        whole, part = (contact_force_torque(terms, point, estimate.F_W, f, np.zeros(7), gains)[0] for f in (F_d, kept))
        np.testing.assert_allclose(hidden.T @ contact_acceleration(terms, point, part.total(), F),
                                   hidden.T @ point.Jdotv_WC, atol=1e-6)  # fmt: skip
        if not M_d:
            np.testing.assert_allclose(whole.total(), part.total(), atol=1e-6)


def test_self_motion_is_damped_and_leaves_the_contact_alone(lwr4):
    gains = gains_of(lwr4)
    for terms, point, F, F_d in contacts(lwr4, [3, 4, 5, 6]):
        torque = contact_force_torque(terms, point, F, F_d, np.zeros(7), gains)[0].null_space
        assert terms.v @ torque <= 1e-9
        if np.linalg.eigvalsh(mobility(terms, point))[0] > 1.0 / MAX_MASS:
            np.testing.assert_allclose(point.Jv_WC @ np.linalg.solve(terms.M, torque), 0.0, atol=1e-8)


# ---- the loop with a hand ------------------------------------------------------------------------------------------


def aligned(F):
    return 15.0 * F / max(np.linalg.norm(F), 1e-9)


@pytest.mark.parametrize("M_d", INERTIAS)
def test_settles_at_15_N_against_a_resisting_hand(lwr4, M_d):
    """A hand of 100 N/m and 20 Ns/m: 15.00 N and a robot at rest, from a push that was weaker or stronger."""
    for F0 in (np.array([2.0, -5.0, 1.0]), np.array([-4.0, -22.0, 3.0])):
        force, velocity = simulate(lwr4, gains_of(lwr4, M_d=M_d), spring(lwr4, 100.0, 20.0, F0), aligned, 3.5)
        assert np.linalg.norm(force[-1]) == pytest.approx(15.0, abs=0.01)
        assert np.linalg.norm(velocity[-1]) < 0.005


def test_the_printed_sign_diverges(lwr4):
    """K_f (F_d − F̂) pushes ever harder into a hand that gives more than 15 N."""
    gains, hand = gains_of(lwr4)._replace(K_f=-4.1 * np.eye(3)), spring(lwr4, 100.0, 20.0, np.array([0.0, -25.0, 0.0]))
    force, velocity = simulate(lwr4, gains, hand, aligned, 0.5)
    assert np.linalg.norm(force, axis=1).max() > 60.0
    assert velocity[:, 1].max() > 1.0
    assert np.linalg.norm(simulate(lwr4, gains_of(lwr4), hand, aligned, 0.5)[0], axis=1).max() < 26.0


def test_drift_grows_as_predicted(lwr4):
    """Nobody resists: |v_y| = (K_f 15/K_d)(1 − e^{−K_d t/M_yy}), against F_d, and nothing across."""
    gains, F_d = gains_of(lwr4, M_d=[10.0, 10.0, 10.0]), np.array([0.0, 15.0, 0.0])
    _, velocity = simulate(lwr4, gains, lambda p, v: np.zeros(3), lambda F: F_d, 0.2, cycles=1)
    expected = free_drift_speed(15.0, 4.1, 10.5, 10.0, 0.001 * np.arange(200))
    np.testing.assert_allclose(-velocity[:, 1], expected, atol=0.01)
    np.testing.assert_allclose(velocity[:, [0, 2]], 0.0, atol=0.01)


# ---- the gate ------------------------------------------------------------------------------------------------------

PARAMS = ContactForceControlParameters()


def test_gate_has_hysteresis():
    """It opens above 3 N, stays open down to 1.5 N, and a force that is not a number closes it."""
    gate = ForceGate()
    for force, opened in ((2.9, False), (3.1, True), (1.6, True), (1.4, False), (2.9, False), (4.0, True)):
        gate = gate.after(CONTACT, force, PARAMS)
        assert gate.open is opened
    assert not gate.after(CONTACT, np.nan, PARAMS).open


@pytest.mark.parametrize("mode", [HOLD, RETURN, YIELD, STOP])
def test_gate_is_closed_without_a_known_contact(mode):
    assert not ForceGate(open=True, size=15.0).after(mode, 20.0, PARAMS).open


def test_size_rises_from_the_estimate_at_the_force_rate():
    """10 N/s: from 5 N to 15 N in a second, from 25 N down as fast; at once if the rate is 0."""
    for force in (5.0, 25.0):
        gate = ForceGate().after(CONTACT, force, PARAMS)
        assert gate.size == force
        for _ in range(100):
            gate = gate.after(CONTACT, 25.0, PARAMS)
        assert gate.size == pytest.approx(force + 0.5 * (15.0 - force))
    at_once = ContactForceControlParameters(force_rate=0.0)
    assert ForceGate().after(CONTACT, 14.0, at_once).size == 15.0


def test_size_does_not_run_after_a_hand_that_leaves():
    gate = ForceGate(open=True, size=15.0).after(CONTACT, 2.0, PARAMS)
    assert gate.size == 2.0 + PARAMS.max_deficit


def test_speed_stop_holds_until_the_release():
    """Weak and strong forces, a lost sight and a lost camera do not end it; a release does."""
    still = np.zeros(3)
    gate = ForceGate(open=True, size=15.0).checked(np.array([0.0, -0.26, 0.0]), still, PARAMS)
    for mode in (CONTACT, YIELD, STOP, CONTACT):
        gate = gate.after(mode, 20.0, PARAMS)
        assert gate.stopped and not gate.open
        np.testing.assert_array_equal(gate.stop_velocity, [0.0, -0.26, 0.0])
    assert gate.status(CONTACT) == ForceStatus.SPEED_STOP
    assert not gate.after(RETURN, 0.0, PARAMS).stopped
    assert ForceGate(open=True).checked(np.full(3, np.nan), still, PARAMS).stopped
    assert ForceGate(open=True).checked(still, np.full(3, np.nan), PARAMS).stopped


def test_speed_stop_looks_ahead():
    """0.1 m/s stops if it would reach the limit soon, and 0.24 m/s even if it falls."""
    v, a = np.array([0.1, 0.0, 0.0]), np.array([10.0, 0.0, 0.0])
    assert not ForceGate(open=True).checked(v, 0.1 * a, PARAMS).stopped
    assert ForceGate(open=True).checked(v, a, PARAMS).stopped
    assert ForceGate(open=True).checked(2.4 * v, -a, PARAMS).stopped


# ---- the system ----------------------------------------------------------------------------------------------------


class Controlled(Bench):
    """A controller with a robot whose state is set by hand."""

    def __init__(self, robot, v=None, **params):
        self.robot, self.v = robot, np.zeros(7) if v is None else v
        self.dynamics = evaluate_dynamics(robot, Q, self.v)
        super().__init__(
            ContactForceController(robot, ContactForceControlParameters(**params)),
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
        np.testing.assert_allclose(bench.read("torque_commanded"), bench.dynamics.g, atol=1e-9)


def test_desired_force_is_aligned_and_grows_to_its_size(lwr4):
    bench = Controlled(lwr4)
    F = 13.0 * STRONG / np.linalg.norm(STRONG)
    bench.run(60, interaction=bench.mode(CONTACT), contact_force=F)
    np.testing.assert_allclose(bench.read("desired_force"), 15.0 * F / 13.0, atol=1e-9)
    np.testing.assert_allclose(bench.read("force_error"), F - 15.0 * F / 13.0, atol=1e-9)


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
    v = np.linalg.pinv(J) @ np.array([0.0, 0.24, 0.0])
    bench = Controlled(lwr4, v, direction="fixed", fixed_force=[0.0, -15.0, 0.0], transition_time=1e-4)
    bench.run(5, interaction=bench.mode(CONTACT), contact_force=STRONG)
    assert bench.status == ForceStatus.SPEED_STOP
    assert bench.read("stop_velocity")[1] > 0.25
    np.testing.assert_array_equal(bench.read("desired_force"), 0.0)
    bench.run(30)
    parts = TorqueTerms(*bench.read("torque_terms").reshape(-1, 7))
    brake = posture_torque(bench.dynamics, Q, np.zeros(7), np.full(7, 30.0))
    np.testing.assert_allclose(parts.total(), brake.total(), atol=1e-3)
    assert v @ parts.task < 0.0
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
        torque = bench.read("torque_commanded")
        for _ in range(5):
            terms = evaluate_dynamics(lwr4, q, v)
            point = terms.point(5, TIP)
            v = v + 0.001 * np.linalg.solve(terms.M, torque - terms.Cv - terms.g + point.Jv_WC.T @ F)
            q = q + 0.001 * v
            speeds.append(np.linalg.norm(point.v_WC))
    assert bench.status == ForceStatus.SPEED_STOP
    assert 0.05 < max(speeds) <= 0.25
    assert bench.read("stop_velocity")[1] < 0.0


@pytest.mark.parametrize("after", InteractionMode)
@pytest.mark.parametrize("before", InteractionMode)
def test_change_of_law_makes_no_jump_and_fades(lwr4, before, after):
    v = 0.02 * np.arange(7)
    bench, alone = Controlled(lwr4, v, transition_time=0.03), Controlled(lwr4, v, transition_time=0.03)
    bench.run(3, interaction=bench.mode(before), contact_force=STRONG)
    torque = bench.read("torque_commanded")
    bench.run()
    bench.set(interaction=bench.mode(after))
    if before != after:
        np.testing.assert_allclose(bench.read("torque_commanded"), torque, atol=1e-9)
    bench.run(120)
    alone.run(120, interaction=alone.mode(after), contact_force=STRONG)
    np.testing.assert_allclose(bench.read("torque_commanded"), alone.read("torque_commanded"), atol=1e-4)


def test_gate_makes_no_jump(lwr4):
    bench = Controlled(lwr4)
    bench.run(3, interaction=bench.mode(CONTACT), contact_force=0.3 * STRONG)
    for force in (STRONG, 0.1 * STRONG, STRONG):
        torque = bench.read("torque_commanded")
        bench.run()
        bench.set(contact_force=force)
        np.testing.assert_allclose(bench.read("torque_commanded"), torque, atol=1e-9)
        bench.run(4)


def test_torque_is_limited_last(lwr4):
    bench = Controlled(lwr4, direction="fixed", fixed_force=[0.0, 9000.0, 0.0], speed_limit=1e3)
    bench.run(200, interaction=bench.mode(CONTACT), contact_force=STRONG)
    torque, excess = bench.read("torque_commanded"), bench.read("torque_excess")
    assert np.all(np.abs(torque) <= lwr4.tau_max) and np.any(excess != 0.0)
    np.testing.assert_allclose(bench.read("torque_terms").reshape(-1, 7).sum(axis=0), torque + excess)


def test_a_misfit_that_is_not_a_number_is_refused(lwr4):
    bench = Controlled(lwr4)
    bench.set(interaction=bench.mode(CONTACT), contact_force=STRONG, misfit=np.full(7, np.nan))
    with pytest.raises(StateError):
        bench.read("torque_commanded")


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


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("direction", "sideways"), ("desired_force", 0.0), ("fixed_force", [1.0, 2.0]), ("fixed_force", [np.nan, 0, 0]),
        ("K_f", -1.0), ("K_d", [1.0, 2.0]), ("M_d", [1.0, -1.0, 1.0]), ("K_N", np.nan), ("gate_on", -1.0),
        ("gate_off", 4.0), ("speed_limit", 0.0),
        ("stop_share", 1.1), ("stop_lead", -0.1), ("force_rate", -1.0), ("max_deficit", 0.0),
        ("hand_stiffness", -1.0), ("brake_time", 0.0), ("period", 0.0),
    ],
)  # fmt: skip
def test_bad_parameters_name_the_field(field, value):
    with pytest.raises((ParameterError, KeyError), match=field):
        ContactForceControlParameters(**{field: value})


def test_parameters_load_with_drake_s_own_loader():
    text = yaml_dump_typed(ContactForceControlParameters(direction="fixed", K_f=2.0))
    assert yaml_load_typed(schema=ContactForceControlParameters, data=text).K_f == 2.0


def test_period_is_that_of_the_cycle():
    assert PARAMS.period == PERIOD
