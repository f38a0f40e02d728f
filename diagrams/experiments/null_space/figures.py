"""Figures of Section 5: the four cases beside one another, and what friction and payload do to each."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.null_space.run import Run
from saphari_drake.simulation.view.figures import CYCLE, blank, legend

WIDTHS = (3.6, 2.6, 1.7, 0.9)  # of the lines of the cases, so that equal ones are all seen
SMALLEST = 1e-5  # mm; lower end of the logarithmic axes


def comparison(runs: Mapping[str, Run], title: str) -> Figure:
    """Return the figure that compares all cases: task error, contact force, elbow, external torque at the task."""
    figure, grid = blank(5, 1, title, share_time=True)
    axes = grid[:, 0]
    heads = (
        ("Task error", "‖x̃‖ [mm], log"),
        ("Task error with an observer", "‖x̃‖ [mm]"),
        ("Contact force", "‖F‖ [N]"),
        ("Elbow displacement", "distance [mm]"),
        (
            "External torque as the task feels it, estimated and true (dotted)",
            r"$\Vert J_M^{\mathrm{\#}T} \tau \Vert$ [N]",
        ),
    )
    for ax, (head, label) in zip(axes, heads):
        ax.set_title(head, loc="left")
        ax.set_ylabel(label)
    for (case, run), color, width in zip(runs.items(), CYCLE, WIDTHS):
        t, style = run.log.time, {"color": color, "label": case, "linewidth": width}
        axes[0].semilogy(t, np.maximum(1e3 * run.error(), SMALLEST), color=color, label=case, linewidth=1.0)
        axes[2].plot(t, np.linalg.norm(run.log["contact"][:, :3], axis=1), **style)
        axes[3].plot(t, 1e3 * run.elbow(), **style)
        if case != "none":
            axes[1].plot(t, 1e3 * run.error(), color=color, label=case)
        estimate(axes[4], run, case, style)
    for ax in axes:
        legend(ax)
    figure.align_ylabels()
    axes[-1].set_xlabel("time [s]")
    return figure


def disturbed(conditions: Mapping[str, Mapping[str, Run]], title: str) -> Figure:
    """Return the figure of all cases in all conditions: task error, and the external torque that the task feels."""
    figure, axes = blank(len(conditions), 2, title, share_time=True)
    for row, (name, runs) in zip(axes, conditions.items()):
        row[0].set_title(f"{name}: task error", loc="left")
        row[0].set_ylabel("‖x̃‖ [mm], log")
        row[1].set_title(f"{name}: estimated and contact alone (dotted)", loc="left")
        row[1].set_ylabel(r"$\Vert J_M^{\mathrm{\#}T} \tau \Vert$ [N]")
        for (case, run), color in zip(runs.items(), CYCLE):
            row[0].semilogy(run.log.time, np.maximum(1e3 * run.error(), SMALLEST), color=color, label=case)
            estimate(row[1], run, case, {"color": color, "label": case})
        row[0].set_ylim(SMALLEST, 100.0)
        row[1].set_ylim(0.0, None)
    legend(axes[0, 1])
    figure.align_ylabels()
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    return figure


def estimate(ax: Axes, run: Run, case: str, style: dict) -> None:
    """Draw what the task feels of the estimated external torque; dotted what it feels of the true contact."""
    true, observed, residual = (np.linalg.norm(force, axis=1) for force in run.task_forces())
    if case != "none":
        ax.plot(run.log.time, residual if case == "momentum" else observed, **style)
    if case in ("none", "momentum"):  # the true torque of the other observers is that of momentum
        color = style["color"] if case == "none" else "black"
        ax.plot(run.log.time, true, ":", color=color, linewidth=2.0, label=f"true, {case}", zorder=5)
