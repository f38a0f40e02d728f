"""Figures and replay of the guiding cell, laid out as Fig. 9 and 10."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from experiments.guiding.judge import true_force, true_velocity
from experiments.guiding.run import GuidingRun
from saphari_drake.control.hand_guiding.touch import GuidingPriority
from saphari_drake.perception.skin.layout import SkinLayout
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.view.figures import DARK, Line, Panel, Shade, intervals, time_panels
from saphari_drake.simulation.view.replay import Arrow, Marker, write_replay
from saphari_drake.simulation.world.cell import Body, add_cell

Array = NDArray[np.float64]
BLUE, ORANGE = (0.0, 0.25, 0.80), (0.84, 0.37, 0.0)
HAND, BOARD = (0.89, 0.71, 0.58), np.array([0.03, 0.20, 0.14, 1.0])
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
        rest = [Line(f"{name} alone", i, f"{axis} alone", DARK[i], ":") for i, axis in enumerate("XYZ")]
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


@dataclass(frozen=True)
class SkinPatch(Body):
    """The modules of a skin, to be seen alone."""

    layout: SkinLayout

    def add_to(self, plant: MultibodyPlant, robot: RobotModel) -> None:
        """Add a thin plate for each."""
        body, side = plant.GetBodyByName(robot.link_names[self.layout.link]), 0.85 * self.layout.params.pitch
        for k, (R, p) in enumerate(zip(self.layout.R_LM, self.layout.p_LM)):
            X_LM = RigidTransform(RotationMatrix(R), p)
            plant.RegisterVisualGeometry(body, X_LM, Box(side, side, 0.010), f"module_{k}", BOARD)


def replay(run: GuidingRun, path: Path, title: str) -> None:
    """Write the run as a page that plays offline: arm, skin, the hands (a ball each) and their forces."""
    setup, log = run.setup, run.log

    overlays: list[Arrow | Marker] = []
    for hand, (name, color) in enumerate((("end effector", ORANGE), ("body", BLUE))):
        point = log["truth"][:, 9 * hand + 3 : 9 * hand + 6]
        force = true_force(run, hand)
        # A hand at the body presses: the arrow ends at the point. One at the end effector pulls as well.
        tail = point - SCALE * force if hand else point
        size = np.maximum(np.linalg.norm(force, axis=1), 1e-9)
        touched = size > 0.1
        overlays += [
            Arrow(f"force on the {name}", tail, force, SCALE, color, touched),
            Marker(f"point on the {name}", point, 0.012, color),
            Marker(f"hand on the {name}", point - 0.045 * force / size[:, None], 0.04, HAND, touched),
        ]
    target = log["truth"][0, 3:6] * np.array([0.5, 0.5, 1.0])
    cell, layout = setup.cell.cell, SkinLayout(setup.robot, setup.scenario.system.skin_layout)
    # From where the skin is seen.
    outwards = setup.robot.kinematics(log["position"][0]).R_WL[layout.link] @ layout.n_L.mean(axis=0)
    camera, skin = (target + outwards + np.array([0.0, 0.0, 0.4]), target), SkinPatch(layout)

    def build(builder: DiagramBuilder) -> MultibodyPlant:
        return add_cell(builder, cell.robot, [*cell.bodies, skin], cell.params).plant

    write_replay(path, build, log.time, log["position"], overlays, camera=camera, title=title)
