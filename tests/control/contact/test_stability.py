"""How stiff a hand may be: the bound against the closed loop's own poles, against the arm, and as a warning."""

import math
import warnings

import numpy as np
import pytest
from force_loop import TIP, Q, gains_of, simulate, spring

from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.control.contact.stability import check_hand, hand_stiffness_limits, max_hand_stiffness
from saphari_drake.errors import StabilityWarning
from saphari_drake.pipelines.contact import ContactPipelineParameters
from saphari_drake.robots.dynamics import evaluate_dynamics


def growth(K_d, K_f, K_I, M_d, Lambda, damping, stiffness):
    """Largest real part of the poles of robot (x, v) and residual F̂ against the hand F = −kx − dv."""
    F = np.array([-stiffness, -damping, 0.0])
    drive = np.array([0.0, -K_d, K_f]) / M_d + (F - [0.0, 0.0, 1.0]) / Lambda
    A = np.array([[0.0, 1.0, 0.0], drive, K_I * (F - [0.0, 0.0, 1.0])])
    return np.linalg.eigvals(A).real.max()


@pytest.mark.parametrize("K_I", [50.0, 100.0])
@pytest.mark.parametrize(("M_d", "Lambda"), [(5.0, 5.0), (2.0, 2.0), (10.0, 4.0), (10.0, 30.0)])
@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_poles_cross_the_axis_at_the_bound(K_I, M_d, Lambda, damping):
    limit = max_hand_stiffness(10.5, 4.1, K_I, M_d, Lambda, damping)
    assert growth(10.5, 4.1, K_I, M_d, Lambda, damping, 0.99 * limit) < 0.0
    assert growth(10.5, 4.1, K_I, M_d, Lambda, damping, 1.01 * limit) > 0.0


def test_values_of_the_deliverable_s_gains():
    """179 and 348 N/m for a natural inertia of 5 kg, K_d K_I/(K_f − 1) for a heavy contact; damping helps tenfold."""
    assert max_hand_stiffness(10.5, 4.1, 50.0, 5.0) == pytest.approx(179.0, abs=1.0)
    assert max_hand_stiffness(10.5, 4.1, 100.0, 5.0) == pytest.approx(348.0, abs=1.5)
    assert max_hand_stiffness(10.5, 4.1, 50.0) == pytest.approx(10.5 * 50.0 / 3.1)
    assert max_hand_stiffness(10.5, 4.1, 50.0, 1e9) == pytest.approx(10.5 * 50.0 / 3.1, rel=1e-4)
    assert max_hand_stiffness(10.5, 4.1, 50.0, 5.0, hand_damping=20.0) > 8.0 * 179.0
    assert math.isinf(max_hand_stiffness(10.5, 4.1, 50.0, 20.0, 4.0))
    assert max_hand_stiffness(10.5, 4.1, 50.0, 5.0, delay=0.0025) < 170.0


@pytest.mark.parametrize(("factor", "stable"), [(0.75, True), (1.3, False)])
@pytest.mark.parametrize("K_I", [50.0, 100.0])
def test_the_arm_settles_below_and_oscillates_above(lwr4, K_I, factor, stable):
    """Natural inertia, undamped hand, law sampled at 5 ms: the motion dies out, or grows."""
    terms = evaluate_dynamics(lwr4, Q, np.zeros(7))
    J = terms.point(5, TIP).Jv_WC
    mass = 1.0 / np.linalg.eigvalsh(J @ np.linalg.solve(terms.M, J.T))[0]  # the heaviest direction
    limit = max_hand_stiffness(10.5, 4.1, K_I, mass, delay=0.0025)
    F0 = np.array([0.0, -15.0, 0.0])
    hand = spring(lwr4, factor * limit, 0.0, 1.05 * F0)
    _, velocity = simulate(lwr4, gains_of(lwr4, M_d=[]), hand, lambda F: F0, 10.0, K_I)
    speed = np.linalg.norm(velocity, axis=1)
    early, late = speed[:500].max(), speed[-500:].max()
    assert (late < 0.1 * early) if stable else (late > 3.0 * early)


def test_a_hand_beyond_the_bound_is_warned_of():
    """With the limit in the text, for each axis; a softer one, a damped one, or none stated is not."""
    stiff = ContactForceControlParameters(hand_stiffness=600.0)
    with pytest.warns(StabilityWarning, match="600 N/m.* along X.* limit is"):
        messages = check_hand(stiff, 100.0)
    assert len(messages) == 3
    limits = hand_stiffness_limits(stiff, 100.0)
    for good in (
        ContactForceControlParameters(),
        ContactForceControlParameters(hand_stiffness=0.9 * limits.min()),
        ContactForceControlParameters(hand_stiffness=600.0, hand_damping=20.0),
    ):
        assert check_hand(good, 100.0) == []


def test_the_pipeline_checks_with_its_observer():
    control = ContactForceControlParameters(hand_stiffness=110.0)
    pipeline = ContactPipelineParameters(controller=control)
    pipeline.observer.gain = 100.0
    with warnings.catch_warnings(record=True) as told:
        pipeline.__post_init__()
    assert told == []
    pipeline.observer.gain = 20.0
    with pytest.warns(StabilityWarning, match="20 1/s"):
        pipeline.__post_init__()
