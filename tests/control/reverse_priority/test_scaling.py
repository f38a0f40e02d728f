"""Acceleration limits of a stack: never exceeded, the tasks give way first, and constraints hold by their buffers."""

import numpy as np
import pytest

from saphari_drake.control.reverse_priority.law import PriorityStatus
from saphari_drake.control.reverse_priority.scaling import Change
from saphari_drake.control.reverse_priority.stack import PriorityStack
from saphari_drake.control.reverse_priority.system import (
    ReversePriorityController,
    ReversePriorityParameters,
    position_reference,
)
from saphari_drake.control.reverse_priority.tasks import Bound, joint_limits, plane_distance, position_task
from saphari_drake.errors import ParameterError

PERIOD, ACCELERATION = 0.001, 8.0
NONE = np.zeros((0, 6))


def stack_of(robot, wall, buffer):
    bound = Bound(plane_distance(robot, "link_7", [0.0, 1.0, 0.0]), upper=wall, buffer=buffer)
    return PriorityStack(robot, [[*joint_limits(robot, 0.01, 0.2), bound], position_task(robot, "link_7", gain=2.0)])


def run(robot, goals, wall=0.15, buffer=0.15, every=400):
    """Return commands, statuses and y of the tip of an arm whose goal jumps."""
    stack, link = stack_of(robot, wall, buffer), robot.link_index("link_7")
    q, v, rows = robot.home.copy(), np.zeros(7), []
    for k in range(every * len(goals)):
        reference = position_reference(goals[k // every])[None]
        change = Change(v, np.full(7, ACCELERATION * PERIOD))
        result = stack.solve(q, 0.95 * v, reference, NONE, PERIOD, change=change)
        assert np.all(np.abs(result.v - v) <= ACCELERATION * PERIOD * (1.0 + 1e-9))
        assert np.all(np.abs(result.v) <= robot.v_max * (1.0 + 1e-9))
        v = result.v
        q = q + PERIOD * v
        rows.append((v, result.status, robot.kinematics(q).position(link, np.zeros(3))[1]))
    return [np.array(column) for column in zip(*rows)]


@pytest.mark.parametrize("seed", range(6))
def test_goals_that_jump_are_followed_within_the_accelerations(lwr4, seed):
    """Behind a wall too: the tip stays before it, as its buffer is wide enough to slow down."""
    rng = np.random.default_rng(seed)
    home = lwr4.kinematics(lwr4.home).position(lwr4.link_index("link_7"), np.zeros(3))
    goals = home + rng.uniform(-0.3, 0.3, (5, 3)) * [0.5, 1.0, 0.5]
    v, status, y = run(lwr4, goals)
    assert y.max() <= 0.15 + 1e-6
    assert np.abs(v).max() > 0.2
    assert PriorityStatus.SCALED in status or PriorityStatus.LATE in status


def test_from_rest_the_tasks_are_scaled_and_the_way_is_kept(lwr4):
    """The first commands have the direction that they have without acceleration limits."""
    stack = stack_of(lwr4, 1.0, 0.1)
    home = lwr4.kinematics(lwr4.home).position(lwr4.link_index("link_7"), np.zeros(3))
    given = lwr4.home, np.zeros(7), position_reference(home + [0.0, 0.2, 0.1])[None], NONE, PERIOD
    free, held = stack.solve(*given), stack.solve(*given, change=Change(np.zeros(7), np.full(7, 0.008)))
    assert held.status == PriorityStatus.SCALED and held.scale < 0.1
    np.testing.assert_allclose(held.v / np.linalg.norm(held.v), free.v / np.linalg.norm(free.v), atol=1e-6)
    assert 0.98 * 0.008 < np.abs(held.v).max() <= 0.008


def test_an_arm_that_moves_slows_down_as_fast_as_it_may(lwr4):
    stack = stack_of(lwr4, 1.0, 0.1)
    home = lwr4.kinematics(lwr4.home).position(lwr4.link_index("link_7"), np.zeros(3))
    before = np.array([0.5, -0.3, 0.2, 0.4, -0.5, 0.3, 0.6])
    given = lwr4.home, np.zeros(7), position_reference(home)[None], NONE, PERIOD
    result = stack.solve(*given, change=Change(before, np.full(7, 0.008)))
    assert result.status == PriorityStatus.LATE
    np.testing.assert_allclose(np.abs(result.v - before).max(), 0.008)
    np.testing.assert_allclose(np.cross((result.v - before)[:3], -before[:3]), 0.0, atol=1e-9)


def test_parameters_are_checked(lwr4):
    with pytest.raises(ParameterError, match="acceleration_max"):
        ReversePriorityParameters(acceleration_max=[-1.0])
    with pytest.raises(ParameterError, match="acceleration_max"):
        ReversePriorityController(
            lwr4, [position_task(lwr4, "link_7")], ReversePriorityParameters(acceleration_max=[1.0, 2.0])
        )
