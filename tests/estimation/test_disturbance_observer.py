"""Disturbance observers of Section 5: signs, energy, what converges, and the checked gains."""

import numpy as np
import pytest
from bench import Bench
from null_space_loop import Loop

from saphari_drake.control.null_space.stability import gamma_bound, require_gamma
from saphari_drake.errors import ParameterError
from saphari_drake.estimation.disturbance_observer import DisturbanceObserver, DisturbanceObserverParameters
from saphari_drake.math.task_space import sampled_damping
from saphari_drake.messages import SystemStatus

F_W = np.array([3.0, -15.0, 4.0])
HOME = np.deg2rad([0.0, -30.0, 0.0, 90.0, 0.0, 60.0, 0.0])


@pytest.mark.parametrize("observer", ["task_error", "task_error_pd"])
def test_printed_sign_diverges_and_corrected_converges(lwr4, observer):
    """(42) and (44) as printed push the arm away from its target; with + the error goes to zero."""
    printed = Loop(lwr4, observer, HOME, sign=-1.0).run(1.5, F_W)
    assert not np.all(np.isfinite(printed)) or printed[-1] > 0.05
    corrected = Loop(lwr4, observer, HOME).run(2.0, F_W)
    assert corrected.max() < 3e-3
    assert corrected[-1] < 0.5 * corrected.max()


def test_energy_of_proposition_1_never_grows(lwr4):
    """V = ½ sᵀΛ_x s + ½ τ̃ᵀΓ τ̃ falls along a run with a constant external torque, in all by ∫ sᵀK s dt."""
    period = 1e-4
    loop = Loop(lwr4, "task_error", HOME, period=period)
    loop.p_d = loop.p_d + np.array([0.03, -0.02, 0.02])
    constant, Gamma = np.array([2.0, -1.0, 0.5, 1.0, 0.2, 0.3, 0.0]), np.linalg.inv(loop.Gamma_inv)
    energy, lost = [], 0.0
    for _ in range(2500):
        loop.step(tau_ext=constant)
        g = loop.controller.gains
        s = loop.e.velocity + g.P * loop.e.error
        wrong = constant - loop.before
        energy.append(0.5 * s @ loop.task.Lambda @ s + 0.5 * wrong @ Gamma @ wrong)
        lost += period * s @ sampled_damping(g.K, loop.task.Lambda, period, s)
    energy = np.array(energy)
    assert np.diff(energy).max() < 2e-4 * energy[0]
    assert energy[0] - energy[-1] == pytest.approx(lost, rel=0.05)


def test_only_the_part_that_the_task_feels_converges(lwr4):
    """J_M^{#T}τ̂ goes to J_M^{#T}τ_ext while τ̂ stays elsewhere; the residual goes to −τ_ext in every joint."""
    loop = Loop(lwr4, "task_error", HOME)
    loop.run(4.0, F_W)
    true, estimated = loop.task.J_inv.T @ loop.tau_ext, loop.task.J_inv.T @ loop.estimate
    np.testing.assert_allclose(estimated, true, atol=0.02 * np.linalg.norm(true))
    assert np.linalg.norm(loop.estimate - loop.tau_ext) > 0.3 * np.linalg.norm(loop.tau_ext)


def test_system_integrates_its_drive_and_clones(lwr4):
    """τ̂ starts at zero and follows Γ⁻¹ y; a cloned Context goes on by itself."""
    params = DisturbanceObserverParameters(Gamma=[0.5], period=0.005)
    bench = Bench(DisturbanceObserver(lwr4, params), observer_drive=np.zeros(7))
    np.testing.assert_array_equal(-bench.read("torque_external"), np.zeros(7))
    bench.run(10, observer_drive=np.arange(7.0))
    np.testing.assert_allclose(-bench.read("torque_external"), 10 * 0.005 / 0.5 * np.arange(7.0))
    twin = bench.clone()
    twin.run(observer_drive=np.ones(7))
    np.testing.assert_allclose(-bench.read("torque_external"), 10 * 0.005 / 0.5 * np.arange(7.0))


def test_estimate_is_forgotten_while_the_task_yields(lwr4):
    """τ̂ decays with `forget_rate` times `yielding`."""
    params = DisturbanceObserverParameters(Gamma=[1.0], period=0.005, forget_rate=10.0)
    bench = Bench(DisturbanceObserver(lwr4, params), observer_drive=np.ones(7), yielding=0.0)
    bench.run(20)
    before = -bench.read("torque_external")
    bench.run(20, observer_drive=np.zeros(7), yielding=0.5)
    np.testing.assert_allclose(-bench.read("torque_external"), np.exp(-0.5) * before)


def test_nothing_is_integrated_while_torque_is_cut_off(lwr4):
    """The estimate waits, and does not wind up."""
    bench = Bench(DisturbanceObserver(lwr4), observer_drive=np.ones(7), torque_excess=np.zeros(7))
    bench.run(5)
    before = bench.read("torque_external")
    bench.run(20, torque_excess=np.eye(7)[6] * 1e-3)
    np.testing.assert_array_equal(bench.read("torque_external"), before)
    bench.run(torque_excess=np.zeros(7))
    assert np.all(bench.read("torque_external") != before)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("port", ["observer_drive", "yielding", "torque_excess"])
def test_an_input_that_is_not_finite_is_told_and_the_estimate_forgotten(lwr4, port, bad):
    """As while the task yields; the state stays finite, and works again at once."""
    params = DisturbanceObserverParameters(period=0.005, forget_rate=10.0)
    good = {"observer_drive": np.ones(7), "yielding": np.zeros(1), "torque_excess": np.zeros(7)}
    bench = Bench(DisturbanceObserver(lwr4, params), **good)
    bench.run(5)
    before = bench.read("torque_external")
    bench.run(20, **{port: np.r_[good[port][:-1], bad]})
    assert bench.read("system_status") == SystemStatus.BAD_INPUT
    np.testing.assert_allclose(bench.read("torque_external"), np.exp(-1.0) * before)
    bench.run(**good)
    assert bench.read("system_status") == SystemStatus.OK
    assert np.all(np.isfinite(bench.read("torque_external")))


def test_gamma_bound_is_the_stated_one():
    """The smaller of both conditions counts."""
    inertia = np.diag([1.0, 2.0, 4.0])
    k, d = np.full(3, 600.0), np.full(3, 60.0)
    assert gamma_bound(inertia, k, d, 3.0) == pytest.approx(min(np.sqrt(600.0) / 4.0, 60.0 / (4.0 + 3.0 + 1.5)))
    assert gamma_bound(inertia, 0.01 * k, d, 3.0) == pytest.approx(60.0 / (7.0 + 150.0))
    with pytest.raises(ParameterError, match=r"gamma: must be below 2"):
        require_gamma(2.0, 2.0)


@pytest.mark.parametrize("field, value", [("rate", 0.0), ("period", -1.0), ("Gamma", [0.1, -0.1]), ("rate", np.nan)])
def test_bad_parameters_are_named(field, value):
    with pytest.raises(ParameterError, match=field):
        DisturbanceObserverParameters(**{field: value})


def test_gamma_of_wrong_size_is_named(lwr4):
    with pytest.raises(ParameterError, match="Gamma"):
        DisturbanceObserver(lwr4, DisturbanceObserverParameters(Gamma=[0.1, 0.2]))
