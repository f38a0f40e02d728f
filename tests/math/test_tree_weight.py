"""Gravity torques of masses that the model lacks, against models that have them."""

from copy import copy

import numpy as np
import pytest
from arms import ARMS, states

from saphari_drake.math.tree_weight import weight_regressor
from saphari_drake.robots.dynamics import evaluate_dynamics


@pytest.mark.parametrize("name", ARMS)
def test_heavier_links_and_a_tool(load_arm, name):
    """The columns, times relative errors of mass, tool mass and first moments, are what a changed model adds."""
    robot, rng = load_arm(name), np.random.default_rng(1)
    tree, n = robot.tree, robot.n
    tool, c = 0.7, np.array([0.02, -0.03, 0.08])
    scale = 1.0 + rng.uniform(-0.2, 0.2, n)
    mass, com = scale * tree.mass, tree.com.copy()
    com[-1] = (mass[-1] * com[-1] + tool * c) / (mass[-1] + tool)
    mass[-1] += tool
    other = copy(robot)
    other.tree = tree._replace(mass=mass, com=com)
    theta = np.concatenate([scale - 1.0, [tool], tool * c])
    for q, v in states(robot, 5):
        terms = evaluate_dynamics(robot, q, v)
        W = weight_regressor(terms.motion, tree.mass, tree.com, tree.gravity)
        np.testing.assert_allclose(terms.g + W @ theta, evaluate_dynamics(other, q, v).g, atol=1e-9)
