"""A robot that the user names in place of a case's own, and the scenario fitted to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from saphari_drake.robots.arm_file import load_arm


def robot_named(given: Mapping[str, Any], assignments: Sequence[str], tree: Mapping[str, Any]) -> str:
    """Return the robot that the user names, or nothing."""
    for text in assignments[::-1]:
        path, _, value = text.partition("=")
        if path.strip() == "robot":
            return value.strip()
    return str(given.get("robot") or tree.get("robot") or "")


def adapted(experiment: Any, scenario: Any, robot: str) -> Any:
    """Return the scenario of a case fitted to another robot (catalog name or path), if that is not its own already."""
    if robot and robot != scenario.robot and experiment.adapt is not None:
        scenario.robot = robot
        experiment.adapt(scenario, load_arm(robot, options=getattr(scenario, "model", None)))
    return scenario
