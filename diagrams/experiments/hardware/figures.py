"""Figure and replay of a run."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from experiments.hardware.run import Run
from saphari_drake.simulation.view.figures import Line, Panel, time_panels
from saphari_drake.simulation.view.replay import write_replay
from saphari_drake.simulation.world.cell import add_cell
from saphari_drake.simulation.world.floor import Floor

PANELS = {
    "contact_impedance": [
        Panel("Contact force, estimated", ["contact_force"], "F̂ [N]"),
        Panel("Contact position error", [Line("position_error", scale=1e3)], "e [mm]"),
    ],
    "null_space": [Panel("Error of the task", [Line("task_error", scale=1e3)], "e [mm]")],
    "hand_guiding": [
        Panel("Force at the tip, out of the residual", [Line("force", i, "XYZ"[i]) for i in range(3)], "F̂ [N]"),
        Panel("Velocity that it asks for", [Line("velocity_desired", i, "XYZ"[i]) for i in range(3)], "v [m/s]"),
    ],
}


def figure(run: Run) -> Figure:
    """Return residual and answer over time, and the state of the robot's cycles."""
    scenario, log = run.setup.scenario, run.log
    panels = [Panel("Residual", ["residual"], "r [Nm]"), *PANELS[scenario.case]]
    if run.truth is not None:
        log.add("force_true", np.interp(log.time, *run.truth), "N")
        panels.append(Panel("True force along the rod", ["force_true"], "F [N]"))
    if run.cycles is not None:
        panels.append(Panel("Cycles of the robot that were missed", ["missed_cycles"], "count"))
    return time_panels(log, panels, f"{scenario.case} on {scenario.address}")


def replay(run: Run, path: Path) -> None:
    """Write the run as a page that plays offline; of a real robot its posture alone."""
    setup, title = run.setup, f"{run.setup.scenario.case} on {run.setup.scenario.address}"
    if setup.cell is not None:
        write_replay(path, setup.cell.copy_to, run.log.time, run.log["plant_position"], title=title)
        return

    def alone(builder: DiagramBuilder) -> MultibodyPlant:
        return add_cell(builder, setup.robot, [Floor()]).plant

    known = np.isfinite(run.log["position_measured"]).all(axis=1)
    write_replay(path, alone, run.log.time[known], run.log["position_measured"][known], title=title)
