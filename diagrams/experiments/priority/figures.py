"""Figures and replays of the reverse-priority experiments."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from experiments.priority.planar import PlanarCell
from experiments.priority.three_level_build import ThreeLevelCell
from saphari_drake.control.reverse_priority.tasks import Bound
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.view.figures import CYCLE, Line, Panel, blank, draw_panel, time_panels
from saphari_drake.simulation.view.overlays import Marker
from saphari_drake.simulation.view.replay import write_replay
from saphari_drake.simulation.world.cell import Body, add_cell

Array = NDArray[np.float64]
BLUE, RED, MAGENTA = CYCLE[0], CYCLE[1], CYCLE[3]
PERSON = (0.0, 0.25, 0.80)
_BOUND = np.array([0.80, 0.47, 0.65, 1.0])


def planar_figure(cell: PlanarCell, log: Log, title: str) -> Figure:
    """Return the figure laid out as Fig. 4: snapshots above; component, activation and task error below."""
    figure, axes = blank(2, 3, title, size=(10.5, 7.5))
    ends = np.searchsorted(log.time, [0.0, *cell.path.arrivals]).clip(0, len(log.time) - 1)
    names = ["start", *(f"goal {i + 1}" for i in range(len(cell.path.arrivals)))]
    for column in range(3):
        ax = axes[0, column]
        if column >= len(ends):
            ax.set_axis_off()
            continue
        _snapshots(ax, cell, log, 0 if column == 0 else int(ends[column - 1]), int(ends[column]))
        ax.set_title(names[column] if column == 0 else f"{names[column - 1]} to {names[column]}", loc="left")
    sides = cell.controller.stack.sides
    bounds = {f"{'upper' if sign > 0 else 'lower'}": bound.upper if sign > 0 else bound.lower for bound, sign in sides}
    labels = ["upper" if sign > 0 else "lower" for _, sign in sides] or ["none"]
    lines: list[Line | str] = [Line("activation", i, label, CYCLE[i]) for i, label in enumerate(labels)]
    panels = [
        Panel("Constrained component", [Line("y4", 0, "y₄", MAGENTA)], "y₄ [m]", bounds),
        Panel("Activation", lines, "h", limits=(-0.05, 1.05)),
        Panel("Task error", [Line("task_error_norm", 0, "‖e‖", RED)], "‖e‖ [m]"),
    ]
    for ax, panel in zip(axes[1], panels):
        draw_panel(ax, log, panel)
        ax.set_xlabel("time [s]")
        if len(panel.signals) + len(panel.bounds) > 1:
            ax.legend(frameon=False, loc="best")
    return figure


def _snapshots(ax, cell: PlanarCell, log: Log, first: int, last: int) -> None:
    rows = np.unique(np.linspace(first, last, 9).astype(int))
    for k, row in enumerate(rows):
        joints = _joints(cell.robot, log["position"][row])
        shade = 0.25 + 0.75 * (k + 1) / len(rows)
        ax.plot(joints[:, 0], joints[:, 1], "-o", color=BLUE, alpha=shade, markersize=2.5, linewidth=1.2)
    fifth = np.array([_joints(cell.robot, q)[4] for q in log["position"][first : last + 1 : 10]])
    if len(fifth):
        ax.plot(fifth[:, 0], fifth[:, 1], color=MAGENTA, linewidth=1.6)
    tips = log["tip"][first : last + 1]
    ax.plot(tips[:, 0], tips[:, 1], color=RED, linewidth=1.6)
    for goal in cell.params.goals:
        ax.plot(*goal, "kx", markersize=6)
    for bound, sign in cell.controller.stack.sides:
        ax.axhline(bound.upper if sign > 0 else bound.lower, color="0.4", linestyle="--", linewidth=0.8)
    ax.set_aspect("equal")
    ax.set_xlim(-1.6, 6.3)
    ax.set_ylim(-4.3, 4.3)
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")


def _joints(robot: RobotModel, q: Array) -> Array:
    """Return the positions of the joints and of the end effector."""
    terms = evaluate_dynamics(robot, q, np.zeros(robot.n))
    link, X_LF = robot.frame("tip")
    return np.vstack([terms.p_WL, terms.p_WL[link] + terms.R_WL[link] @ X_LF.translation()])


@dataclass(frozen=True)
class Bounds(Body):
    """Bounds of y as lines in the plane z = 0."""

    y: tuple[float, ...]  # m

    def add_to(self, plant: MultibodyPlant, robot: RobotModel) -> None:
        """Add the lines, to be seen alone."""
        for k, y in enumerate(self.y):
            X_WL = RigidTransform([2.5, y, -0.1])
            plant.RegisterVisualGeometry(plant.world_body(), X_WL, Box(8.0, 0.04, 0.01), f"bound_{k}", _BOUND)


def planar_replay(cell: PlanarCell, log: Log, path: Path, title: str) -> None:
    """Write the run as a page that plays offline."""
    rows = slice(None, None, 4)

    goals = [
        Marker(f"goal {i + 1}", np.array([*goal, 0.0]), 0.1, (0.84, 0.37, 0.0))
        for i, goal in enumerate(cell.params.goals)
    ]
    bounds = [bound.upper if sign > 0 else bound.lower for bound, sign in cell.controller.stack.sides]
    view = ((2.5, 0.0, 11.0), (2.5, 0.1, 0.0))
    write_replay(
        path,
        lambda builder: add_cell(builder, cell.robot, [Bounds(tuple(bounds))]).plant,
        log.time[rows],
        log["position"][rows],
        goals,
        camera=view,
        title=title,
    )


def three_level_figure(cell: ThreeLevelCell, log: Log, title: str) -> Figure:
    """Return clearance, activations, path error, elbow and speed over time."""
    p = cell.job.params
    shown = [i for i in range(log["activation"].shape[1]) if log["activation"][:, i].max() > 0.01]
    sides = cell.controller.stack.sides
    lines: list[Line | str] = [
        Line("activation", i, _side(*sides[i]), CYCLE[k % len(CYCLE)], "-" if k < len(CYCLE) else "--")
        for k, i in enumerate(shown)
    ]
    panels = [
        Panel("Least clearance from the person", [Line("clearance_min")], "[m]", {"bound": p.clearance}),
        Panel("Activation", lines, "h", limits=(-0.05, 1.05)),
        Panel("Error of the end-effector path", [Line("path_error", 0, "‖e‖", RED)], "[m]"),
        Panel("Elbow", [Line("elbow", 1, "y", MAGENTA)], "y [m]", {"soft low": p.elbow[0], "soft high": p.elbow[1]}),
        Panel("Largest commanded speed", [Line("speed_share", 0, "|q̇|/limit")], "share", {"limit": 1.0}),
    ]
    return time_panels(log, panels, title)


def three_level_replay(cell: ThreeLevelCell, log: Log, path: Path, title: str) -> None:
    """Write the run as a page that plays offline: arm, person and the point that the end effector should be at."""
    rows = slice(None, None, 20)
    persons = log["person"][rows].reshape(-1, 2, 6)
    overlays = [
        Marker("hand", persons[:, 0, :3], 0.065, PERSON),
        Marker("elbow", persons[:, 1, :3], 0.065, PERSON),
        Marker("reference", log["reference"][rows, :3], 0.015, (0.0, 0.62, 0.45)),
    ]
    view = ((1.9, -1.2, 1.2), (0.3, 0.0, 0.5))
    times, q = log.time[rows], log["position"][rows]
    write_replay(path, cell.cell.copy_to, times, q, overlays, camera=view, title=title)


def _side(bound: Bound, sign: float) -> str:
    return f"{bound.component.name}, {'upper' if sign > 0 else 'lower'}"
