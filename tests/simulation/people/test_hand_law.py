"""The law of a hand: its spring pulls to where the person wants it, and its damper takes energy, whatever it does."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from saphari_drake.math.rotations import axis_rotation
from saphari_drake.simulation.people.hand_law import hand_wrench

DOWN = np.array([0.0, 0.0, -1.0])
K, D, K_TURN, D_TURN = 300.0, 20.0, 8.0, 0.5


def wrench(pose, velocity, goal=None, most=np.inf):
    """Return torque and force of a hand at a pose with a velocity (6,), angular first; without a goal it is there."""
    goal = goal or pose
    state = np.r_[pose.rotation().ToQuaternion().wxyz(), pose.translation(), velocity]
    place = goal.translation(), np.ascontiguousarray(goal.rotation().matrix())
    return hand_wrench(state, *place, DOWN, most, K, D, K_TURN, D_TURN)


def pose_of(rng):
    axis = rng.normal(size=3)
    turn = axis_rotation(axis / np.linalg.norm(axis), rng.uniform(0.1, 3.0))
    return RigidTransform(RotationMatrix(turn), rng.uniform(-1.0, 1.0, 3))


@pytest.mark.parametrize("seed", range(20))
def test_a_passive_hand_dissipates(seed):
    """Where nothing pulls it back, the power of its wrench is −D v² − D_ω ω²; so is what velocity adds to a pull."""
    rng = np.random.default_rng(seed)
    pose, goal, velocity = pose_of(rng), pose_of(rng), rng.normal(size=6)
    lost = D_TURN * velocity[:3] @ velocity[:3] + D * velocity[3:] @ velocity[3:]
    assert wrench(pose, velocity) @ velocity == pytest.approx(-lost, rel=1e-6)
    for most in (np.inf, 5.0):
        pulled = wrench(pose, velocity, goal, most) - wrench(pose, np.zeros(6), goal, most)
        assert pulled @ velocity == pytest.approx(-lost, rel=1e-6)


@pytest.mark.parametrize("part", range(6))
def test_every_direction_is_damped(part):
    velocity = np.eye(6)[part]
    np.testing.assert_allclose(wrench(RigidTransform(), velocity), -[D_TURN, D][part // 3] * velocity, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_pulled_hand_comes_to_rest_at_its_goal(seed):
    """As a mass of 1 kg and 0.01 kg m² without any other damping; its energy never grows beyond that of the spring."""
    rng = np.random.default_rng(seed)
    p, v, goal = rng.uniform(-0.1, 0.1, 3), np.zeros(3), RigidTransform()
    energy = [0.5 * K * p @ p]
    for _ in range(2000):
        v = v + 1e-3 * wrench(RigidTransform(p), np.r_[np.zeros(3), v], goal)[3:]
        p = p + 1e-3 * v
        energy.append(0.5 * (K * p @ p + v @ v))
    assert np.linalg.norm(p) < 1e-4 and np.linalg.norm(v) < 1e-3 and max(energy) < 1.2 * energy[0]
