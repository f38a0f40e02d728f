"""Hands around another arm: what they pull keeps its joints clear of their limits."""

import numpy as np
from arms import arm_path
from experiments.placement import guiding
from skin_hand_guiding import scenario_for

from saphari_drake.robots.arm_file import load_arm


def test_hands_lead_the_arm_clear_of_its_limits(monkeypatch):
    """As written for the LWR4, the pulls fold a Panda to the limit of its elbow."""
    path = str(arm_path("panda", None))
    given, placed = scenario_for("end_effector_first"), scenario_for("end_effector_first")
    given.robot = placed.robot = path
    guiding.place_hands(placed, load_arm(path))
    robot = load_arm(path, home=np.deg2rad(placed.home))
    assert [guiding.held_back(placed, robot, second) for second in (0.0, 1.0, 3.0)] == [0, 0, 0]
    monkeypatch.setattr(guiding, "held_back", lambda *_: 0)
    guiding.place_hands(given, load_arm(path))
    monkeypatch.undo()
    assert guiding.held_back(given, robot, 1.0) > 0
    sizes = [sorted(np.linalg.norm(pull.size) for pull in scenario.end_effector.pulls) for scenario in (given, placed)]
    np.testing.assert_allclose(*sizes)  # turned, no weaker than need be
