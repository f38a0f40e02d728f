"""Figures and replay of the guiding cell, laid out as Fig. 9 and 10."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.guiding.judge import true_force, true_velocity
from experiments.guiding.run import GuidingRun
from saphari_drake.control.hand_guiding.touch import GuidingPriority
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.view.figures import Line, Panel, Shade, intervals, time_panels
from saphari_drake.simulation.view.replay import Arrow, Marker, write_replay

Array = NDArray[np.float64]
BLUE, ORANGE = (0.0, 0.25, 0.80), (0.84, 0.37, 0.0)
SCALE = 0.02  # m/N


def forces_and_velocities(run: GuidingRun, alone: GuidingRun, title: str) -> Figure:
    """Return the figure: (a) F_e, (b) ṗ_e, (c) F_b, (d) ṗ_b in world axes; dotted, the main point led by one hand."""
    log = Log(run.log.time)
    log.add("F_e", run.log["force"][:, :3], "N")
    log.add("F_b", run.log["force"][:, 3:], "N")
    for hand, name in enumerate(("v_e", "v_b")):
        log.add(name, true_velocity(run, hand), "m/s")
        log.add(f"{name} alone", true_velocity(alone, hand), "m/s")
    main = "v_b" if run.setup.scenario.main else "v_e"

    def velocity(name: str) -> list[Line | str]:
        if name != main:
            return [Line(name)]
        rest = [Line(f"{name} alone", i, f"{axis} alone", "black", ":") for i, axis in enumerate("XYZ")]
        return [Line(name), *rest]

    priority = run.log["priority"][:, 0]
    shades = [
        Shade(intervals(log.time, priority == GuidingPriority.END_EFFECTOR), "main: end effector", "#E8A87C"),
        Shade(intervals(log.time, priority == GuidingPriority.BODY), "main: body", "#9DB9E8"),
    ]
    panels = [
        Panel("(a) Force at the end effector, wrist sensor", ["F_e"], "F_e [N]"),
        Panel("(b) Velocity of the end effector", velocity("v_e"), "ṗ_e [m/s]"),
        Panel("(c) Force on the body, skin", ["F_b"], "F_b [N]"),
        Panel("(d) Velocity of the contact point on the body", velocity("v_b"), "ṗ_b [m/s]"),
    ]
    return time_panels(log, panels, title, shades)


def replay(run: GuidingRun, path: Path, title: str) -> None:
    """Write the run as a page that plays offline: arm, skin, true forces, and forces as measured on the skin."""
    setup, log = run.setup, run.log

    overlays: list[Arrow | Marker] = []
    for hand, (name, color) in enumerate((("end effector", ORANGE), ("body", BLUE))):
        point = log["truth"][:, 9 * hand + 3 : 9 * hand + 6]
        force = true_force(run, hand)
        # A hand at the body presses: the arrow ends at the point. One at the end effector pulls as well.
        tail = point - SCALE * force if hand else point
        touched = np.linalg.norm(force, axis=1) > 0.1
        overlays += [
            Arrow(f"force on the {name}", tail, force, SCALE, color, touched),
            Marker(f"point on the {name}", point, 0.012, color),
        ]
    target = log["truth"][0, 3:6] * np.array([0.5, 0.5, 1.0])
    camera = (target + np.array([1.0, 1.0, 0.5]), target)
    write_replay(path, setup.cell.cell.copy_to, log.time, log["position"], overlays, camera=camera, title=title)
