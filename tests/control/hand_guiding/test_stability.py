"""How stiff a hand may be: the linear loop against matrix exponentials, and against the arm on both sides."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from guided_arm import HOME, TIP
from scipy.linalg import expm

from saphari_drake.control.hand_guiding.law import HandGuiding
from saphari_drake.control.hand_guiding.parameters import GuidedPointParameters, HandGuidingParameters
from saphari_drake.control.hand_guiding.stability import (
    GuidingLoop,
    check_hand,
    growth,
    max_hand_stiffness,
    transition_matrix,
)
from saphari_drake.control.hand_guiding.system import HandGuidingController, sense
from saphari_drake.errors import StabilityWarning
from saphari_drake.messages import SkinReading
from saphari_drake.robots.dynamics import evaluate_dynamics


@pytest.mark.parametrize("servo", [None, (4e4, 400.0)])
@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_motion_between_cycles_is_exact(servo, damping):
    """The rows of position and velocity are those of the matrix exponential of hand, arm and servo."""
    loop = GuidingLoop(arm_mass=2.0, hand_damping=damping, servo=servo)
    k, T = 800.0, loop.params.period
    A = transition_matrix(loop, k)
    K, D = servo or (0.0, 0.0)
    F = np.array([[0.0, 1.0], [-K - k / 2.0, -D - damping / 2.0]])
    drive = np.linalg.solve(F, expm(F * T) - np.eye(2)) @ [0.0, 1.0]
    x = np.random.default_rng(0).standard_normal(9)
    following = A @ x
    u = (following[:2] - expm(F * T) @ x[:2]) @ drive / (drive @ drive)
    np.testing.assert_allclose(following[:2], expm(F * T) @ x[:2] + drive * u, atol=1e-9)
    assert following[2] == pytest.approx(x[0])


def test_the_default_gains_hold_with_hands_from_100_to_3000():
    """Both points, light and heavy directions of the arm, both interfaces; also with a filter of 2 ms on the force."""
    params = HandGuidingParameters()
    for point in (params.end_effector, params.body):
        for arm_mass in (1.0, 3.0, 10.0):
            for loop in (
                GuidingLoop(params),
                GuidingLoop(params, force_lag=0.002),
                GuidingLoop(HandGuidingParameters(feedback="commanded"), servo=(4e4, 400.0)),
            ):
                own = replace(loop, mass=point.mass[0], damping=point.damping[0], arm_mass=arm_mass)
                for k in np.geomspace(100.0, 3000.0, 8):
                    assert growth(own, k) < 0.0


def test_a_force_that_is_smoothed_before_it_is_fed_forward_costs_stiffness():
    """The gains of skin_hand_guiding hold with hands of up to 2000 N/m on a wrist of 0.1 kg, and of 3000 on 0.3 kg."""

    def stiffest(arm_mass, **changes):
        params = HandGuidingParameters(K_P=6400.0, K_D=160.0, **changes)
        return max_hand_stiffness(GuidingLoop(params, arm_mass=arm_mass, differentiated=False))

    assert 2000.0 < stiffest(0.1, force_time=0.005) < 0.5 * stiffest(0.1)
    assert stiffest(0.3, force_time=0.005) > 3000.0
    assert stiffest(0.1, force_time=0.01) < stiffest(0.1, force_time=0.005)


def test_growth_and_bound_agree_and_delay_costs_stiffness():
    loop = GuidingLoop(mass=2.0, damping=10.0, force_delay=1)
    limit = max_hand_stiffness(loop)
    assert growth(loop, 0.98 * limit) < 0.0 < growth(loop, 1.02 * limit)
    assert limit < max_hand_stiffness(replace(loop, force_delay=0))
    assert limit < max_hand_stiffness(replace(loop, damping=30.0))


def test_a_stated_hand_that_is_too_stiff_is_warned_of(lwr4):
    """By the controller, naming the limit, which is that of the lightest direction of the end effector at home."""

    def params(stiffness):
        return HandGuidingParameters(tip_point=TIP.tolist(), K_P=6400.0, K_D=160.0, hand_stiffness=stiffness)

    robot = lwr4.with_home(HOME)
    limit = check_hand(robot, params(0.0), 6, TIP)
    terms = evaluate_dynamics(robot, HOME, np.zeros(7))
    J = terms.point(6, TIP).Jv_WC
    masses = 1.0 / np.linalg.eigvalsh(J @ np.linalg.solve(terms.M, J.T))
    assert limit == min(max_hand_stiffness(GuidingLoop(params(0.0), arm_mass=m, differentiated=False)) for m in masses)
    with pytest.warns(StabilityWarning, match=f"the limit is {limit:.0f} N/m"):
        HandGuidingController(robot, params(1.01 * limit))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        HandGuidingController(robot, params(0.99 * limit))


@pytest.mark.parametrize(("factor", "stable"), [(0.6, True), (1.7, False)])
def test_the_arm_settles_below_and_oscillates_above(lwr4, factor, stable):
    """The whole arm with a spring at its tip and forces a few cycles late: oscillation dies out, or grows."""
    delay, mass, damping = 6, 2.0, 12.0
    params = HandGuidingParameters(
        feedback="commanded",
        tip_point=TIP.tolist(),
        end_effector=GuidedPointParameters([mass] * 3, [damping] * 3, max_speed=5.0, workspace_radius=0.0),
    )
    # A stiff, heavy arm follows its command whatever the hand does: in the linear loop, a fast servo.
    loop = GuidingLoop(params, mass, damping, 50.0, force_delay=delay, servo=(2.5e5, 1000.0))
    stiffness = factor * max_hand_stiffness(loop)
    guiding = HandGuiding(lwr4, params)
    state = guiding.start(evaluate_dynamics(lwr4, HOME, np.zeros(7)))
    anchor, forces, speeds = None, [np.zeros(3)] * delay, []
    for k in range(1000):
        terms = evaluate_dynamics(lwr4, state.q, state.v)
        at = terms.point(6, TIP)
        if anchor is None:
            anchor = at.p_WC + np.array([0.0, 0.0, 6.0 / stiffness])
        forces.append(stiffness * (anchor - at.p_WC) if k > 5 else np.zeros(3))
        wrench = np.concatenate([np.zeros(3), forces.pop(0)])
        state, _ = guiding.step(state, terms, sense(terms, SkinReading(), wrench, guiding.tip))
        speeds.append(np.linalg.norm(at.v_WC))
    early, late = np.max(speeds[50:150]), np.max(speeds[-100:])
    assert (late < 0.4 * early) if stable else (late > 2.0 * early)
