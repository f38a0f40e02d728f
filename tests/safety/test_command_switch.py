"""The switch: what each mode passes on, changes without a jump, and faults."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from bench import PERIOD, Bench
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import ParameterError
from saphari_drake.messages import CommandMode, Selection, SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.command_switch import CommandSwitch, CommandSwitchParameters, posture_torque
from saphari_drake.safety.torque_limit import TorqueLimit

HOLD, PASS, BRAKE, YIELD = CommandMode
RECOVERY = round(CommandSwitchParameters().recovery_time / PERIOD) + 1
COMMAND = np.array([20.0, -30.0, 10.0, 5.0, 1.0, -1.0, 0.1])
BAD = [np.nan, np.inf, -np.inf]


class Switched(Bench):
    """A switch, and a robot whose state is set by hand."""

    def __init__(self, robot, q=None, v=None, system=None, **params):
        self.robot = robot
        q, v = robot.home if q is None else q, np.zeros(7) if v is None else v
        self.terms = evaluate_dynamics(robot, q, v)
        system = system or CommandSwitch(robot, CommandSwitchParameters(**params))
        super().__init__(system, dynamics=self.terms, selection=self.selection(), torque_commanded=COMMAND)

    def selection(self, mode=PASS, *key):
        return Selection(mode, self.robot.home, key)

    @property
    def torque(self):
        return self.read("torque_commanded")

    @property
    def status(self):
        return self.read("system_status")


@pytest.fixture
def moving(lwr4):
    rng = np.random.default_rng(2)
    return lwr4.home + rng.uniform(-0.05, 0.05, 7), rng.uniform(-0.3, 0.3, 7)


# ---- modes ---------------------------------------------------------------------------------------------------------


def test_posture_torque_is_computed_torque(lwr4):
    """q̈ = K (q_d − q) − D q̇, each joint for itself, the light wrist included."""
    K, D, rng = np.linspace(100.0, 250.0, 7), np.linspace(10.0, 30.0, 7), np.random.default_rng(0)
    for _ in range(10):
        terms = evaluate_dynamics(lwr4, rng.uniform(lwr4.q_min, lwr4.q_max), rng.uniform(-1, 1, 7))
        torque = posture_torque(terms, lwr4.home, K, D)
        vdot = np.linalg.solve(terms.M, torque - terms.Cv - terms.g)
        np.testing.assert_allclose(vdot, K * (lwr4.home - terms.q) - D * terms.v, atol=1e-6)


@pytest.mark.parametrize(
    ("mode", "stiffness", "damping"), [(HOLD, 225.0, 30.0), (BRAKE, 0.0, 30.0), (YIELD, 25.0, 10.0)]
)
def test_each_mode_is_its_computed_torque(lwr4, moving, mode, stiffness, damping):
    """HOLD pulls to the latched posture, YIELD softly, BRAKE takes the speed out. The command is not read."""
    bench = Switched(lwr4, *moving)
    bench.set(selection=bench.selection(mode), torque_commanded=np.full(7, np.nan))
    d = bench.terms
    expected = d.M @ (stiffness * (lwr4.home - d.q) - damping * d.v) + d.Cv + d.g
    np.testing.assert_allclose(bench.torque, expected, atol=1e-12)
    assert bench.status == SystemStatus.OK


def test_braking_holds_where_it_comes_to_rest(lwr4, moving):
    bench = Switched(lwr4, *moving)
    bench.run(20, selection=bench.selection(BRAKE))
    rest = evaluate_dynamics(lwr4, moving[0] + 0.05, np.full(7, 0.01))
    bench.run(2, dynamics=rest)
    sunk = evaluate_dynamics(lwr4, rest.q + 0.02, rest.v)
    bench.run(20, dynamics=sunk)
    held = posture_torque(sunk, rest.q, np.full(7, 225.0), np.full(7, 30.0))
    np.testing.assert_allclose(bench.torque - bench.read("transition"), held, atol=1e-9)
    bench.run(selection=bench.selection())
    bench.run(selection=bench.selection(BRAKE))
    np.testing.assert_allclose(
        bench.torque - bench.read("transition"), posture_torque(sunk, sunk.q, np.full(7, 0.0), np.full(7, 30.0))
    )


def test_braking_holds_after_its_time_also_what_does_not_come_to_rest(lwr4, moving):
    """A weight that the model lacks keeps the arm sinking."""
    bench = Switched(lwr4, *moving, rest_time=0.2)
    bench.run(41, selection=bench.selection(BRAKE))
    sunk = evaluate_dynamics(lwr4, moving[0] + 0.1, moving[1])
    bench.run(20, dynamics=sunk)
    held = posture_torque(sunk, moving[0], np.full(7, 225.0), np.full(7, 30.0))
    np.testing.assert_allclose(bench.torque - bench.read("transition"), held, atol=1e-9)


def test_a_command_passes_as_it_is(lwr4, moving):
    """With a selection and without one."""
    bench = Switched(lwr4, *moving)
    np.testing.assert_array_equal(bench.torque, COMMAND)
    alone = CommandSwitch(lwr4)
    context = alone.CreateDefaultContext()
    bare = object.__new__(Bench)
    bare.system, bare.cycles = alone, 0
    bare._attach(context)
    bare.set(dynamics=bench.terms, torque_commanded=COMMAND)
    np.testing.assert_array_equal(bare.read("torque_commanded"), COMMAND)


# ---- hand-over -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("before", "after"), list(itertools.permutations(CommandMode, 2)))
def test_change_of_mode_makes_no_jump_and_fades_with_its_time(lwr4, moving, before, after):
    bench, alone = Switched(lwr4, *moving, transition_time=0.03, brake_time=0.02), Switched(lwr4, *moving)
    bench.run(3, selection=bench.selection(before))
    torque = bench.torque
    bench.run()
    bench.set(selection=bench.selection(after))
    np.testing.assert_allclose(bench.torque, torque, atol=1e-9)
    alone.set(selection=alone.selection(after))
    difference = bench.torque - alone.torque
    np.testing.assert_allclose(bench.read("transition"), difference, atol=1e-9)
    time = 0.02 if after == BRAKE else 0.03
    for k in range(1, 4):
        bench.run()
        np.testing.assert_allclose(bench.torque - alone.torque, np.exp(-k * PERIOD / time) * difference, atol=1e-9)
        np.testing.assert_array_equal(bench.read("transition_left"), bench.read("transition"))
    bench.run(120)
    np.testing.assert_allclose(bench.torque, alone.torque, atol=1e-6)


def test_a_new_key_hands_over_and_a_command_that_changes_does_not(lwr4):
    bench = Switched(lwr4)
    bench.run(3)
    bench.set(torque_commanded=2.0 * COMMAND)
    np.testing.assert_array_equal(bench.torque, 2.0 * COMMAND)
    bench.run()
    bench.set(torque_commanded=COMMAND, selection=bench.selection(PASS, 1))
    np.testing.assert_allclose(bench.torque, 2.0 * COMMAND)


def limited(robot):
    """Return switch and torque limit as one system, wired as in a pipeline."""
    builder = DiagramBuilder()
    switch, limit = builder.AddSystem(CommandSwitch(robot)), builder.AddSystem(TorqueLimit(robot, PERIOD))
    builder.Connect(switch.GetOutputPort("torque_commanded"), limit.GetInputPort("torque_commanded"))
    builder.Connect(limit.GetOutputPort("torque_applied"), switch.GetInputPort("torque_applied"))
    for name in ("dynamics", "selection", "torque_commanded"):
        builder.ExportInput(switch.GetInputPort(name), name)
    for system, name in (
        (switch, "transition"), (switch, "system_status"), (limit, "torque_applied"), (limit, "torque_excess"),
    ):  # fmt: skip
        builder.ExportOutput(system.GetOutputPort(name), name)
    return builder.Build()


def test_hands_over_from_what_was_applied(lwr4):
    """Not from a command that the limit cut: that torque never was."""
    bench = Switched(lwr4, system=limited(lwr4))
    bench.run(3, torque_commanded=1e4 * np.ones(7))
    np.testing.assert_array_equal(bench.read("torque_applied"), lwr4.tau_max)
    bench.run()
    bench.set(selection=bench.selection(YIELD))
    np.testing.assert_allclose(bench.read("torque_applied"), lwr4.tau_max)
    np.testing.assert_allclose(bench.read("transition"), lwr4.tau_max - bench.terms.g)


# ---- faults --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("cycles", [1, 2, 40])
def test_a_command_that_is_lost_holds_where_it_began_and_then_passes_again(lwr4, moving, bad, cycles):
    """No jump at either end; good again, it waits for the recovery time."""
    bench = Switched(lwr4, *moving)
    bench.run(3)
    before = bench.torque
    bench.run()
    bench.set(torque_commanded=np.r_[COMMAND[:6], bad])
    np.testing.assert_allclose(bench.torque, before, atol=1e-9)
    assert bench.status == SystemStatus.HOLDING
    bench.run(cycles)
    moved = evaluate_dynamics(lwr4, moving[0] + 0.01, 0.0 * moving[1])
    bench.set(dynamics=moved)
    held = posture_torque(moved, moving[0], np.full(7, 225.0), np.full(7, 30.0))
    np.testing.assert_allclose(bench.torque - bench.read("transition"), held, atol=1e-9)
    bench.run(torque_commanded=COMMAND)
    bench.run(RECOVERY - 3)
    for _ in range(4):
        at_last, status = bench.torque, bench.status
        bench.run()
        np.testing.assert_allclose(bench.torque, at_last, atol=0.05 * np.abs(at_last - COMMAND).max())
        if status == SystemStatus.HOLDING:
            recovered = bench.status
    assert recovered == bench.status == SystemStatus.OK
    bench.run(400)
    np.testing.assert_allclose(bench.torque, COMMAND, atol=1e-6)


def test_a_posture_that_cannot_be_held_is_a_fault(lwr4, moving):
    """Not finite, or of a wrong size: the present posture is held instead."""
    for q_latched in (np.full(7, np.nan), np.zeros(6), np.zeros(0)):
        bench = Switched(lwr4, *moving)
        bench.run(3, selection=replace(bench.selection(HOLD), q_latched=q_latched))
        assert bench.status == SystemStatus.HOLDING
        bench.run(100)
        d = bench.terms
        np.testing.assert_allclose(bench.torque, d.M @ (-30.0 * d.v) + d.Cv + d.g, atol=1e-6)


def test_an_unknown_state_leaves_gravity_asks_for_brakes_and_holds_where_it_is_known_again(lwr4, moving):
    bench = Switched(lwr4, *moving)
    bench.run(3)
    before = bench.torque
    bench.run()
    bench.set(dynamics=bench.terms.unknown())
    np.testing.assert_allclose(bench.torque, before, atol=1e-9)
    assert bench.status == SystemStatus.BRAKES_ON
    # What is foreseen to be left of the momentum is taken out, and gone soon.
    braking = bench.terms.M @ (-30.0 * bench.terms.v) + bench.terms.g
    np.testing.assert_allclose(bench.torque - bench.read("transition"), braking, atol=1e-9)
    bench.run(200)
    np.testing.assert_allclose(bench.torque, bench.terms.g, atol=1e-6)
    elsewhere = evaluate_dynamics(lwr4, moving[0] + 0.1, np.zeros(7))
    bench.run(2, dynamics=elsewhere)
    assert bench.status == SystemStatus.HOLDING
    bench.run(10)
    np.testing.assert_allclose(bench.torque, elsewhere.g, atol=0.3)
    bench.run(RECOVERY)
    assert bench.status == SystemStatus.OK


def test_a_state_that_never_was_known_leaves_the_weight_at_home(lwr4):
    bench = Switched(lwr4)
    bench.run(5, dynamics=bench.terms.unknown())
    np.testing.assert_allclose(bench.torque, evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g)


@pytest.mark.parametrize("seed", range(20))
def test_whatever_comes_the_applied_torque_is_finite_and_within_the_limits(lwr4, seed):
    """Random faults of command, posture and state, of random length, in random modes; afterwards all is well."""
    rng, bench = np.random.default_rng(seed), Switched(lwr4, system=limited(lwr4))
    for _ in range(150):
        terms = evaluate_dynamics(lwr4, lwr4.home + rng.uniform(-0.3, 0.3, 7), rng.uniform(-1, 1, 7))
        selection = Selection(CommandMode(rng.integers(4)), rng.choice([np.nan, 1.0]) * lwr4.home, (rng.integers(2),))
        command = rng.normal(size=7) * 10.0 ** rng.uniform(0, 300)
        command[rng.integers(7)] *= rng.choice([1.0, 1.0, *BAD])
        bench.run(
            int(rng.integers(1, 4)),
            dynamics=terms.unknown() if rng.random() < 0.2 else terms,
            selection=selection,
            torque_commanded=command,
        )
        torque = bench.read("torque_applied")
        assert np.isfinite(torque).all() and np.all(np.abs(torque) <= lwr4.tau_max)
    bench.run(2 * RECOVERY, dynamics=bench.terms, selection=bench.selection(), torque_commanded=COMMAND)
    assert bench.read("system_status") == SystemStatus.OK
    bench.run(400)
    np.testing.assert_allclose(bench.read("torque_applied"), COMMAND, atol=1e-6)


def test_what_is_left_depends_on_no_input(lwr4):
    """So that a controller can be told; that no output depends on the applied torque, `limited` shows by building."""
    switch = CommandSwitch(lwr4)
    through = {name: switch.HasDirectFeedthrough(switch.GetOutputPort(name).get_index())
               for name in ("transition_left", "transition", "torque_commanded")}  # fmt: skip
    assert through == {"transition_left": False, "transition": True, "torque_commanded": True}


def test_a_clone_goes_its_own_way(lwr4, moving):
    bench = Switched(lwr4, *moving)
    bench.run(3)
    twin = bench.clone()
    twin.run(10, selection=bench.selection(YIELD))
    np.testing.assert_array_equal(bench.torque, COMMAND)
    bench.run(10, selection=bench.selection(YIELD))
    np.testing.assert_array_equal(bench.torque, twin.read("torque_commanded"))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("yield_travel", 0.0), ("rest_speed", np.nan),
        ("hold_stiffness", -1.0), ("hold_damping", np.inf), ("yield_damping", [10.0, -1.0]), ("transition_time", 0.0),
        ("brake_time", 0.0), ("recovery_time", np.nan), ("period", 0.0),
    ],
)  # fmt: skip
def test_bad_parameters_name_the_field(field, value):
    with pytest.raises(ParameterError, match=field):
        CommandSwitchParameters(**{field: value})


@pytest.mark.parametrize("name", ["hold_stiffness", "yield_stiffness", "yield_damping", "yield_travel"])
def test_gains_of_the_wrong_size_are_named(lwr4, name):
    with pytest.raises(ParameterError, match=name):
        CommandSwitch(lwr4, CommandSwitchParameters(**{name: [1.0, 2.0]}))
