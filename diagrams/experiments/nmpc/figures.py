"""Figures and replays of the predictive control, laid out after Fig. 1 to 3."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from experiments.nmpc.jobs import frame_pose, point_positions
from experiments.nmpc.run import NmpcRun
from saphari_drake.control.nmpc.parameters import NmpcStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.view.figures import BOUND, CYCLE, STYLE, blank, legend
from saphari_drake.simulation.view.overlays import Arrow, Marker
from saphari_drake.simulation.view.replay import write_replay

Array = NDArray[np.float64]
BLUE, RED, GREEN = CYCLE[0], CYCLE[1], CYCLE[2]
_AXES = "xyz"


def _in_style(draw: Callable[[NmpcRun, str], Figure]) -> Callable[[NmpcRun, str], Figure]:
    @wraps(draw)
    def styled(run: NmpcRun, title: str) -> Figure:
        with rc_context(STYLE):
            return draw(run, title)

    return styled


@_in_style
def mobile_figure(run: NmpcRun, title: str) -> Figure:
    """Return the figure after Fig. 2 and 3: from above, end effector in y–z, computing time, clearance, errors."""
    figure, axes = blank(3, 2, title, size=(11.0, 9.5))
    log = run.log
    _posture_view(axes[0, 0], run, (1, 0), np.linspace(0, len(log.time) - 1, 7).astype(int).tolist(), circles=2)
    axes[0, 0].set_title("From above: platform with d_min, end effector", loc="left")
    _path_view(axes[0, 1], run, (1, 2))
    axes[0, 1].set_title("End effector (Fig. 3a)", loc="left")
    _computing_time(axes[1, 0], run)
    axes[1, 0].set_title("Computing time a step [ms] (Fig. 3b)", loc="left")
    _clearance(axes[1, 1], run)
    for name, factor, color, label in (
        ("position_error", 1.0, BLUE, "position [m]"),
        ("orientation_error", 1.0, RED, "orientation [rad]"),
    ):
        axes[2, 0].plot(log.time, factor * log[name][:, 0], color=color, label=label)
    axes[2, 0].set_title("Error of the end effector", loc="left")
    axes[2, 0].legend(frameon=False)
    _status(axes[2, 1], run)
    for ax in axes[1:].ravel():
        ax.set_xlabel("time [s]")
        ax.set_xlim(log.time[0], log.time[-1])
    return figure


@_in_style
def manipulator_figure(run: NmpcRun, title: str) -> Figure:
    """Return the figure after Fig. 1: start and end seen from the side and from the front, then errors over time."""
    figure, axes = blank(2, 3, title, size=(12.5, 8.0))
    log = run.log
    for column, (row, name) in enumerate(((0, "start"), (len(log.time) - 1, "end"))):
        _posture_view(axes[0, column], run, (0, 2), [row])
        axes[0, column].set_title(f"{name.capitalize()}, from the side (Fig. 1)", loc="left")
    for name in ("x", "y"):  # start and end on the same axes
        limits = np.array([getattr(ax, f"get_{name}lim")() for ax in axes[0, :2]])
        for ax in axes[0, :2]:
            getattr(ax, f"set_{name}lim")(limits[:, 0].min(), limits[:, 1].max())
    _posture_view(axes[0, 2], run, (1, 2), [len(log.time) - 1])
    axes[0, 2].set_title("End, from the front", loc="left")
    axes[1, 0].semilogy(log.time, np.maximum(log["position_error"][:, 0], 1e-7), color=BLUE, label="position [m]")
    axes[1, 0].semilogy(log.time, np.maximum(log["orientation_error"][:, 0], 1e-7), color=RED, label="angle [rad]")
    axes[1, 0].set_title("Error of the end effector", loc="left")
    axes[1, 0].legend(frameon=False)
    axes[1, 1].plot(log.time, log["distance"][:, 0], color=BLUE, label="least distance")
    axes[1, 1].axhline(min(point.d_min for point in run.cell.job.points), color=BOUND, linestyle="--", label="d_min")
    axes[1, 1].set_title("Distance of test points from obstacles [m]", loc="left")
    axes[1, 1].legend(frameon=False)
    _computing_time(axes[1, 2], run)
    for ax in axes[1]:
        ax.set_xlabel("time [s]")
        ax.set_xlim(log.time[0], log.time[-1])
    return figure


def _posture_view(
    ax: Axes, run: NmpcRun, plane: tuple[int, int], rows: Sequence[int], circles: int | None = None
) -> None:
    """Draw postures, test spheres, obstacles and the end effector's path, projected on two axes."""
    job, log = run.cell.job, run.log
    a, b = plane
    for k, row in enumerate(rows):
        terms = evaluate_dynamics(job.robot, log["position"][row], np.zeros(job.robot.n))
        chain = np.vstack([_visible(terms.p_WL), frame_pose(job.robot, job.end_effector, terms)[1]])
        shade = 0.3 + 0.7 * (k + 1) / len(rows)
        ax.plot(chain[:, a], chain[:, b], "-o", color="0.25", alpha=shade, markersize=2.5, linewidth=1.2)
        centers = point_positions(job.robot, job.points, terms)
        for point, center in list(zip(job.points, centers))[:circles]:
            ax.add_patch(Circle((center[a], center[b]), point.d_min, facecolor=BLUE, alpha=0.10, edgecolor=BLUE))
        obstacles = job.obstacles(log.time[row])
        for p, radius in zip(obstacles.p_WO, obstacles.radius):
            ax.add_patch(Circle((p[a], p[b]), max(radius, 0.02), color=GREEN, alpha=shade))
    ax.plot(log["reference"][:, a], log["reference"][:, b], "--", color="0.5", linewidth=0.8)
    ax.plot(log["tip"][:, a], log["tip"][:, b], color=RED, linewidth=1.4)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.set_xlabel(f"{_AXES[a]} [m]")
    ax.set_ylabel(f"{_AXES[b]} [m]")


def _visible(p_WL: Array) -> Array:
    """Leave out links that have not left the world's origin: the carriages of a platform."""
    return p_WL[np.linalg.norm(p_WL[:, :2] - p_WL[-1, :2], axis=1) < 1.5]


def _path_view(ax: Axes, run: NmpcRun, plane: tuple[int, int]) -> None:
    log, (a, b) = run.log, plane
    ax.plot(log["reference"][:, a], log["reference"][:, b], "--", color="0.5", label="reference")
    ax.plot(log["tip"][:, a], log["tip"][:, b], color=BLUE, label="end effector")
    obstacles = run.cell.job.obstacles(float(log.time[-1]))
    ax.plot(
        obstacles.p_WO[:, a], obstacles.p_WO[:, b], "o", color=GREEN, markersize=4, label="obstacle points, at the end"
    )
    ax.set_xlabel(f"{_AXES[a]} [m]")
    ax.set_ylabel(f"{_AXES[b]} [m]")
    ax.legend(frameon=False)


def _computing_time(ax: Axes, run: NmpcRun) -> None:
    """Draw the computing time of each step."""
    steps = run.steps
    ax.semilogy(steps.time[1:], 1e3 * np.maximum(steps["step_time"][1:, 0], 1e-6), ".", color=BLUE, markersize=3)
    ax.set_title("Computing time a step [ms]", loc="left")


def _clearance(ax: Axes, run: NmpcRun) -> None:
    ax.plot(run.log.time, run.log["clearance"][:, 0], color=BLUE)
    ax.axhline(0.0, color=BOUND, linestyle="--")
    ax.set_title("Least clearance: distance − d_min − radius [m]", loc="left")


def _status(ax: Axes, run: NmpcRun) -> None:
    status = run.steps["status"][:, 0]
    ax.step(run.steps.time, status, where="post", color=BLUE)
    shown = sorted({int(value) for value in status})
    ax.set_yticks(shown, [NmpcStatus(value).name.lower() for value in shown])
    ax.set_title("Status of the controller", loc="left")
    legend(ax)


def nmpc_replay(run: NmpcRun, path: Path, title: str, view: tuple, fps: float = 20.0) -> None:
    """Write the run as a page that plays offline: robot, test spheres, obstacles, predicted motion and reference."""
    job, log = run.cell.job, run.log
    every = max(1, round(1.0 / (fps * (log.time[1] - log.time[0]))))
    rows = np.arange(0, len(log.time), every)
    times = log.time[rows]
    terms = [evaluate_dynamics(job.robot, q, np.zeros(job.robot.n)) for q in log["position"][rows]]
    spheres = np.array([point_positions(job.robot, job.points, item) for item in terms])
    overlays: list[Arrow | Marker] = [
        Marker(f"test {point.name}", spheres[:, k], point.d_min, (0.2, 0.4, 0.9, 0.12))
        for k, point in enumerate(job.points)
    ]
    overlays.append(Marker("reference", log["reference"][rows], 0.02, (0.90, 0.75, 0.0)))
    overlays += _predicted(run, times)
    obstacles = [job.obstacles(time) for time in times]
    for j, radius in enumerate(obstacles[0].radius):
        if radius == 0.0:  # a person's points are drawn as a body
            position = np.array([points.p_WO[j] for points in obstacles])
            overlays.append(Marker(f"obstacle {j}", position, 0.04, (0.0, 0.62, 0.3)))
        else:
            overlays.append(
                Marker(f"person {j}", np.array([points.p_WO[j] for points in obstacles]), radius, (0.87, 0.62, 0.45))
            )
    write_replay(
        path,
        run.cell.cell.copy_to,
        times,
        log["position"][rows],
        overlays,
        fps=fps,
        camera=view,
        title=title,
    )


def _predicted(run: NmpcRun, times: Array) -> list[Arrow | Marker]:
    """Small balls along the end effector's predicted path, as planned in each control period."""
    job, steps = run.cell.job, run.steps
    n = job.robot.n
    motion = steps["predicted_motion"].reshape(len(steps.time), -1, n)
    stages = range(2, motion.shape[1], 2)
    held = np.searchsorted(steps.time, times + 1e-9, side="right") - 1
    result: list[Arrow | Marker] = []
    for k in stages:
        tips = [frame_pose(job.robot, job.end_effector, evaluate_dynamics(job.robot, q, np.zeros(n)))[1]
                for q in motion[:, k]]  # fmt: skip
        result.append(Marker(f"predicted {k}", np.array(tips)[held], 0.012, (0.80, 0.1, 0.5)))
    return result
