"""Friction with a memory of the last direction, and the observer that knows it."""

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.errors import ParameterError
from saphari_drake.estimation.joint_friction import JointFrictionParameters, joint_friction
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters
from saphari_drake.robots.dynamics import evaluate_dynamics

FRICTION = JointFrictionParameters(coulomb=[3.0, 2.0, 2.0, 2.0, 2.0, 1.0, 1.5], viscous=4.0)


def test_moving_it_brakes_with_its_full_size_and_at_rest_it_remembers(lwr4):
    friction = joint_friction(FRICTION, lwr4)
    v = np.array([0.2, -0.2, 0.5, -0.5, 0.1, -0.1, 0.3])
    share = friction.after(np.zeros(7), 0.05 * v)
    np.testing.assert_allclose(share, np.sign(v), atol=1e-3)
    np.testing.assert_allclose(friction.torque(share, v), -np.array(FRICTION.coulomb) * np.sign(v) - 4.0 * v, atol=1e-2)
    np.testing.assert_array_equal(friction.after(share, np.zeros(7)), share)


def test_turning_round_takes_its_way_and_not_a_step_of_an_encoder(lwr4):
    friction = joint_friction(FRICTION, lwr4)
    np.testing.assert_allclose(friction.after(np.ones(7), np.full(7, -1e-5)), 1.0, atol=0.25)
    np.testing.assert_allclose(friction.after(np.ones(7), np.full(7, -3e-3)), -1.0, atol=0.01)


@pytest.mark.parametrize("way", [1e-5, 1e-3, 1.0])
def test_a_way_in_parts_is_the_way(way, lwr4):
    friction = joint_friction(FRICTION, lwr4)
    parts = np.full(7, -0.4)
    for _ in range(10):
        parts = friction.after(parts, np.full(7, 0.1 * way))
    np.testing.assert_allclose(parts, friction.after(np.full(7, -0.4), np.full(7, way)), atol=1e-12)


def test_the_observer_sees_a_touch_behind_known_friction(lwr4):
    """Held at a constant speed against friction and a hand: the residual is the hand's torque."""
    v, hand = np.full(7, 0.1), np.array([1.0, -2.0, 0.5, 1.0, 0.0, 0.2, 0.0])
    terms = evaluate_dynamics(lwr4, lwr4.home, v)
    observer = MomentumObserver(lwr4, MomentumObserverParameters(gain=50.0, friction=FRICTION))
    rubbing = -np.array(FRICTION.coulomb) - 4.0 * v
    bench = Bench(observer, dynamics=terms, torque_applied=terms.g - terms.CTv - rubbing - hand)
    bench.run(round(1.0 / PERIOD))
    np.testing.assert_allclose(bench.read("torque_external"), hand, atol=0.01)


def test_the_bias_of_the_drives_is_no_touch(lwr4):
    """At rest, held by drives that give 0.3 Nm more or less than they are asked for."""
    bias, terms = (
        0.3 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0]),
        evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)),
    )
    for known, expected in ((bias.tolist(), np.zeros(7)), ([], bias)):
        params = MomentumObserverParameters(friction=JointFrictionParameters(bias=known))
        bench = Bench(MomentumObserver(lwr4, params), dynamics=terms, torque_applied=terms.g - bias)
        bench.run(round(1.0 / PERIOD))
        np.testing.assert_allclose(bench.read("torque_external"), expected, atol=1e-6)
    with pytest.raises(ParameterError, match="7 joints, got 2"):
        joint_friction(JointFrictionParameters(bias=[0.1, 0.2]), lwr4)


def test_damping_of_the_model_file_is_no_touch(load_arm):
    """An arm with 2 to 10 Nms/rad moves at a constant speed; what was identified replaces it."""
    xarm, v = load_arm("xarm7"), np.full(7, 0.2)
    terms = evaluate_dynamics(xarm, xarm.home, v)
    assert xarm.viscous.min() >= 2.0
    for friction, expected in (
        (JointFrictionParameters(), np.zeros(7)),
        (JointFrictionParameters(viscous=0.0), -xarm.viscous * v),
        (JointFrictionParameters(viscous=(xarm.viscous + 1.0).tolist()), v),
    ):
        observer = MomentumObserver(xarm, MomentumObserverParameters(friction=friction))
        bench = Bench(observer, dynamics=terms, torque_applied=terms.g - terms.CTv + xarm.viscous * v)
        bench.run(round(1.0 / PERIOD))
        np.testing.assert_allclose(bench.read("torque_external"), expected, atol=1e-3)


@pytest.mark.parametrize(("name", "value"), [("coulomb", -1.0), ("viscous", np.nan), ("turn", 0.0), ("bias", [np.inf])])
def test_bad_parameters(name, value):
    with pytest.raises(ParameterError, match=name):
        JointFrictionParameters(**{name: value})
