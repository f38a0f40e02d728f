"""The impedance controller as a system: what it answers, what it selects, and the chain behind it."""

from dataclasses import replace

import numpy as np
import pytest
from bench import PERIOD, Bench
from command_chain import chained

from saphari_drake.control.contact.law import ImpedanceGains, TorqueTerms, contact_impedance_torque
from saphari_drake.control.contact.parameters import ContactImpedanceParameters
from saphari_drake.control.contact.system import ContactImpedanceController
from saphari_drake.errors import ParameterError
from saphari_drake.messages import CommandMode, ContactPoint, Interaction, InteractionMode, SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics

HOLD, CONTACT, RETURN, YIELD, STOP = InteractionMode
M_D = np.diag([20.0, 3.0, 10.0])
MAX_MASS = ContactImpedanceParameters().max_effective_mass


class Controlled(Bench):
    """A controller with a robot whose state is set by hand."""

    def __init__(self, robot, q=None, v=None, **params):
        self.robot = robot
        self.q = robot.home if q is None else q
        self.v = np.zeros(7) if v is None else v
        switch = {"transition_time": params.pop("transition_time", 0.1)}
        controller = ContactImpedanceController(robot, ContactImpedanceParameters(**params))
        super().__init__(
            chained(controller, robot, **switch),
            dynamics=evaluate_dynamics(robot, self.q, self.v),
            interaction=self.mode(HOLD),
            contact_force=np.zeros(3),
            misfit=np.zeros(7),
        )

    def mode(self, mode, onset=0, link=5):
        """An interaction whose posture was latched at home."""
        answered = mode in (CONTACT, RETURN)
        point = ContactPoint(found=True, link=link, p_LC=np.array([0.05, 0.0, 0.06])) if answered else ContactPoint()
        return Interaction(mode, point, self.robot.home, onset)

    @property
    def terms(self):
        return TorqueTerms(*self.read("torque_terms").reshape(-1, 7))

    @property
    def torque(self):
        return self.read("torque_applied")


@pytest.fixture
def moving(lwr4):
    """A robot a little away from its latched posture, in motion, in each mode that is asked for."""
    rng = np.random.default_rng(2)
    q, v = lwr4.home + rng.uniform(-0.05, 0.05, 7), rng.uniform(-0.3, 0.3, 7)

    def start(mode, **params):
        bench = Controlled(lwr4, q, v, **params)
        bench.set(interaction=bench.mode(mode), contact_force=[5.0, -8.0, 3.0], misfit=0.1 * np.ones(7))
        return bench

    return start


@pytest.mark.parametrize(
    ("mode", "selected"),
    [
        (HOLD, CommandMode.HOLD), (CONTACT, CommandMode.PASS), (RETURN, CommandMode.PASS), (YIELD, CommandMode.YIELD),
        (STOP, CommandMode.BRAKE),
    ],
)  # fmt: skip
def test_selects_by_mode_and_carries_the_weight_meanwhile(moving, lwr4, mode, selected):
    """Contact and return are the law's; without a contact its own command is the weight, and no error is told."""
    bench = moving(mode)
    selection = bench.read("selection")
    assert selection.mode == selected and selection.key == (0, bench.mode(mode).contact.link)
    np.testing.assert_array_equal(selection.q_latched, lwr4.home)
    if selected != CommandMode.PASS:
        terms = evaluate_dynamics(lwr4, bench.q, bench.v)
        np.testing.assert_allclose(bench.read("torque_commanded"), terms.Cv + terms.g)
        np.testing.assert_array_equal(bench.read("position_error"), 0.0)


def test_contact_answers_with_the_law_at_the_latched_point(moving, lwr4):
    """x_d is where the point of the body was when the contact began."""
    bench = moving(CONTACT, M_d=[20.0, 3.0, 10.0])
    contact = bench.mode(CONTACT).contact
    terms = evaluate_dynamics(lwr4, bench.q, bench.v)
    point = terms.point(contact.link, contact.p_LC)
    p_desired = lwr4.kinematics(lwr4.home).position(contact.link, contact.p_LC)
    law = ImpedanceGains(500.0 * np.eye(3), 80.0 * np.eye(3), np.linalg.inv(M_D), np.full(7, 20.0), 0.03, MAX_MASS)
    expected = contact_impedance_torque(terms, point, p_desired, np.array([5.0, -8.0, 3.0]), 0.1 * np.ones(7), law)
    for actual, part in zip(bench.terms, expected, strict=True):
        np.testing.assert_allclose(actual, part, atol=1e-12)
    np.testing.assert_array_equal(bench.read("position_error"), p_desired - point.p_WC)
    np.testing.assert_array_equal(bench.read("contact_position"), point.p_WC)


def test_return_is_the_same_law_as_contact_for_the_contact(moving):
    """Beside it, self-motion goes back to the latched posture, and nothing is cancelled where nothing may be."""
    back, touched = moving(RETURN, return_torque=0.0, misfit_lever=0.0), moving(CONTACT, misfit_lever=0.0)
    d, contact = evaluate_dynamics(back.robot, back.q, back.v), back.mode(RETURN).contact
    J = d.point(contact.link, contact.p_LC).Jv_WC
    pull = np.linalg.solve(d.M, back.torque - touched.torque)
    np.testing.assert_allclose(J @ pull, 0.0, atol=1e-6)
    assert np.abs(pull).max() > 0.01


@pytest.mark.parametrize("after", InteractionMode)
@pytest.mark.parametrize("before", InteractionMode)
def test_change_of_mode_makes_no_jump_and_fades(moving, before, after):
    """The torque goes on from where it was, and tends to that of the new law with its time; a stop is quick."""
    fade = 0.01 if after == STOP else 0.1
    bench, alone = moving(before, transition_time=0.1), moving(after)
    bench.run(3)
    old, new = bench.torque, alone.torque
    bench.set(interaction=bench.mode(after, onset=1))
    np.testing.assert_allclose(bench.torque, old, atol=1e-9)
    for k in range(1, 200):
        bench.run()
        expected = new + (old - new) * np.exp(-k * PERIOD / fade)
        np.testing.assert_allclose(bench.torque, expected, atol=1e-9)
    np.testing.assert_allclose(bench.torque, new, atol=1e-2)


def test_change_of_mode_during_a_transition_makes_no_jump_either(moving):
    """The torque goes on from the one that acted in the cycle before."""
    bench = moving(HOLD)
    bench.run()
    for onset, mode in enumerate((CONTACT, YIELD, CONTACT, STOP, HOLD), start=1):
        bench.run(2)
        before = bench.torque
        bench.run()
        bench.set(interaction=bench.mode(mode, onset))
        np.testing.assert_allclose(bench.torque, before, atol=1e-9)


def test_new_contact_point_on_another_link_makes_no_jump(moving):
    bench = moving(CONTACT)
    bench.run(2)
    before = bench.torque
    bench.set(interaction=bench.mode(CONTACT, onset=1, link=3))
    np.testing.assert_allclose(bench.torque, before, atol=1e-9)


BAD = {
    "dynamics": lambda bench, bad: evaluate_dynamics(bench.robot, bench.q, bench.v).unknown(),
    "contact_force": lambda bench, bad: [0.0, bad, 0.0],
    "misfit": lambda bench, bad: np.r_[bad, np.zeros(6)],
    "interaction": lambda bench, bad: replace(bench.mode(CONTACT), q_latched=np.r_[np.zeros(6), bad]),
}


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("port", BAD)
def test_an_input_that_is_not_finite_makes_no_command_but_a_status(moving, lwr4, port, bad):
    """The chain holds the posture meanwhile, and goes on afterwards."""
    bench = moving(CONTACT, M_d=[20.0, 3.0, 10.0])
    bench.run(3)
    bench.set(**{port: BAD[port](bench, bad)})
    assert bench.read("system_status") == SystemStatus.BAD_INPUT
    assert np.isnan(bench.read("torque_commanded")).any()
    held = SystemStatus.BRAKES_ON if port == "dynamics" else SystemStatus.HOLDING
    for _ in range(3):
        assert np.isfinite(bench.torque).all() and bench.read("switch_status") == held
        bench.run()
    good = moving(CONTACT)
    names = ("dynamics", "contact_force", "misfit", "interaction")
    bench.set(**{name: good.system.GetInputPort(name).Eval(good.context) for name in names})
    assert bench.read("system_status") == SystemStatus.OK
    bench.run(30)
    assert bench.read("switch_status") == SystemStatus.OK


@pytest.mark.parametrize(
    "contact",
    [
        ContactPoint(True, 7, np.zeros(3)),
        ContactPoint(True, -1, np.zeros(3)),
        ContactPoint(True, 5, np.full(3, np.nan)),
    ],
)
def test_a_contact_that_cannot_be_is_bad_input(moving, contact):
    bench = moving(CONTACT)
    bench.set(interaction=replace(bench.mode(CONTACT), contact=contact))
    assert bench.read("system_status") == SystemStatus.BAD_INPUT


def test_a_posture_of_a_wrong_size_is_bad_input(moving):
    bench = moving(CONTACT)
    bench.set(interaction=replace(bench.mode(CONTACT), q_latched=np.zeros(6)))
    assert bench.read("system_status") == SystemStatus.BAD_INPUT
    assert np.isfinite(bench.torque).all()


def test_joint_gains_of_the_wrong_size(lwr4):
    with pytest.raises(ParameterError, match="^K_N: needs 1 or 7 entries"):
        ContactImpedanceController(lwr4, ContactImpedanceParameters(K_N=[1.0, 2.0]))
