"""Figure and replay of a run of the safe cell."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from experiments.cell.judge import CellRun
from saphari_drake.safety.supervisor.law import CellState, Event
from saphari_drake.simulation.people.skeleton import SEGMENTS
from saphari_drake.simulation.view.figures import blank
from saphari_drake.simulation.view.replay import Arrow, Marker, write_replay
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.pedestal import Pedestal

COLORS = {
    CellState.FREE: "#7fbf7f", CellState.SLOWED: "#ffd966", CellState.STOP: "#f4a582", CellState.CONTACT: "#92c5de",
    CellState.GUIDING: "#c2a5cf", CellState.FAULT: "#d6604d",
}  # fmt: skip
WORDS = {
    CellState.FREE: "works", CellState.SLOWED: "works, slower", CellState.STOP: "waits", CellState.CONTACT: "gives way",
    CellState.GUIDING: "is led", CellState.FAULT: "broken",
}  # fmt: skip


def cell_figure(run: CellRun, title: str) -> Figure:
    """Return state, separation, speed, contact force and progress over time."""
    figure, grid = blank(4, 1, title, (8.5, 9.0))
    axes, fast, slow = list(grid[:, 0]), run.fast, run.slow
    state = fast["state"][:, 0].astype(int)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(state)) + 1, [len(state) - 1]])
    spans = list(itertools.pairwise(edges))
    for axis in axes:
        for a, b in spans:
            axis.axvspan(fast.time[a], fast.time[b], color=COLORS[CellState(state[a])], alpha=0.45, lw=0)
    for a, b in spans:
        if fast.time[b] - fast.time[a] > 0.06 * fast.time[-1]:
            axes[0].text(
                0.5 * (fast.time[a] + fast.time[b]), 1.02, WORDS[CellState(state[a])], ha="center", va="bottom",
                fontsize=8, transform=axes[0].get_xaxis_transform(),
            )  # fmt: skip
    gap = np.where(np.isfinite(fast["gap"][:, 0]), fast["gap"][:, 0], np.nan)
    axes[0].plot(fast.time, gap, "k", label="true distance of the person")
    axes[0].plot(slow.time, slow["separation"][:, 0], "C0.", ms=2, label="as the cameras see it")
    axes[0].plot(slow.time, slow["protective_distance"][:, 0], "C3", label="protective distance")
    axes[0].set_ylim(-0.05, 0.8)
    axes[0].set_ylabel("Distance [m]")
    speed = np.abs(fast["velocity"] / run.rig.robot.v_max).max(axis=1)
    axes[1].plot(fast.time, speed, "k", label="fastest joint, of its limit")
    axes[1].plot(slow.time, slow["speed_limit"][:, 0], "C3", label="share of the job's speed that is allowed")
    axes[1].set_ylabel("Speed [1]")
    axes[2].plot(fast.time, np.linalg.norm(fast["touch"][:, :3], axis=1), "k", label="contact force")
    for hit in run.hits:
        axes[2].annotate(
            f"{hit.segment}: {hit.energy:.2g} J of {hit.limit:.2g} J", (hit.time, hit.force), fontsize=7, rotation=20
        )
    axes[2].set_ylabel("Force [N]")
    axes[3].plot(slow.time, slow["progress"][:, 0] / run.rig.scenario.job_time, "k", label="share of the job done")
    axes[3].set_ylabel("Job [1]")
    axes[3].set_xlabel("Time [s]")
    for axis in axes:
        axis.legend(fontsize=7, loc="upper right")
        axis.set_xlim(0.0, fast.time[-1])
    return figure


def cell_replay(run: CellRun, path: Path, title: str) -> None:
    """Write a page that shows robot, person and contact force, and the robot's state as a colour and in words."""
    slow, fast = run.slow, run.fast
    ends = slow["ends"].reshape(len(slow.time), -1, 2, 3)
    overlays: list[Arrow | Marker] = []
    radii = run.rig.scenario.people.sizes.radii()
    for k, segment in enumerate(SEGMENTS):
        length = float(np.median(np.linalg.norm(ends[:, k, 1] - ends[:, k, 0], axis=1)))
        count = max(1, int(np.ceil(length / radii[k])) + 1)
        color = (0.87, 0.62, 0.45) if segment.region in ("skull", "neck", "hand", "forearm") else (0.35, 0.45, 0.62)
        for j in range(count):
            share = j / max(count - 1, 1)
            at = ends[:, k, 0] + share * (ends[:, k, 1] - ends[:, k, 0])
            overlays.append(Marker(f"{segment.name} {j}", at, float(radii[k]), color))
    rows = np.searchsorted(fast.time, slow.time - 1e-9).clip(0, len(fast.time) - 1)
    state = fast["state"][rows, 0].astype(int)
    for which, hue in COLORS.items():
        rgb = [int(hue[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        above = [0.0, 0.0, 2.0]
        overlays.append(Marker(f"state: {WORDS[which]}", np.array([above]), 0.09, rgb, state == which))
    touch = fast["touch"][rows]
    overlays.append(Arrow("force", touch[:, 3:6], touch[:, :3], 0.005, (0.84, 0.1, 0.1)))
    words = "; ".join(f"{_name(COLORS[which])}: {WORDS[which]}" for which in COLORS)
    cell = run.rig.cell
    height = run.rig.scenario.base_height if run.rig.scenario.case == "fixed" else 0.0

    def build(builder: DiagramBuilder) -> MultibodyPlant:
        return add_cell(builder, cell.robot, [*cell.bodies, *([Pedestal(height)] if height else [])], cell.params).plant

    write_replay(
        path, build, slow.time, slow["position"], overlays, camera=((1.2, -3.0, 2.2), (0.5, 0.0, 1.0)),
        title=f"{title} Ball above the robot: {words}. Red arrow: contact force.", captions=captions_of(run),
    )  # fmt: skip


def captions_of(run: CellRun) -> list[str]:
    """Return of each frame state, reason, separation, and the energy that a contact would have at the allowed speed."""
    slow, fast = run.slow, run.fast
    rows, told = np.searchsorted(fast.time, slow.time - 1e-9).clip(0, len(fast.time) - 1), []
    for k, row in enumerate(rows):
        state, why = CellState(int(fast["state"][row, 0])), Event(int(fast["reason"][row, 0]))
        energy = slow["energy"][k, 0] * slow["speed_limit"][k, 0] ** 2
        apart, force = slow["separation"][k, 0], float(np.linalg.norm(fast["touch"][row, :3]))
        told.append(
            f"{slow.time[k]:4.1f} s   robot {WORDS[state]} ({why.name.lower().replace('_', ' ')})"
            f"   separation {_told(apart, 'm')}   energy of a contact {_told(energy, 'J')}"
            f" of {_told(slow['energy_limit'][k, 0], 'J')}   contact force {_told(force, 'N')}"
        )
    return told


def _told(value: float, unit: str) -> str:
    return f"{value:.2f} {unit}" if np.isfinite(value) else "–"


def _name(color: str) -> str:
    return {
        "#7fbf7f": "green", "#ffd966": "yellow", "#f4a582": "orange", "#92c5de": "blue", "#c2a5cf": "violet",
        "#d6604d": "red",
    }[color]  # fmt: skip
