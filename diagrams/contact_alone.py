"""Nobody touches an arm whose links and tool are not those of its model: it stays where it is and feels nobody."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from experiments.contact.cell import ContactCell
from experiments.contact.run import ContactScenario, ContactSetup, build_contact, replay_contact, run_contact
from experiments.placement.contact import place_in_cell, pushes_on_links
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from saphari_drake.messages import InteractionMode
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions
from saphari_drake.simulation.view.figures import Panel, time_panels
from saphari_drake.simulation.world.profile import PlantProfile

CASES = {
    "links": "each link's mass off by up to 5 %",
    "tool": "links as well, and an unknown tool of 0.5 kg",
    "blind": "the same, and the camera is lost after 2 s: a stop",
}
TIP = np.array([0.0, 0.0, 0.1])  # m, in the last link


@dataclass
class ContactAloneScenario(ContactScenario):
    """Everything a run depends on."""

    case: str = "tool"


def scenario_for(case: str) -> ContactAloneScenario:
    """Return the scenario of a case."""
    scenario = ContactAloneScenario(case=case, duration=20.0, plant="realistic")
    scenario.realistic = PlantProfile(mass_error=0.05, payload=0.0 if case == "links" else 0.5)
    scenario.system.camera.renderer = "raycast"
    # The hand waits beside the arm, and never comes.
    scenario.pushes = [Push("link_6", [0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [], 30.0, 1e6, 1.0)]
    if case == "blind":
        scenario.duration, scenario.faults, scenario.fault_time = 12.0, ["camera_dropout"], 2.0
    return scenario


def adapt(scenario: ContactAloneScenario, robot: RobotModel) -> None:
    """Fit a scenario to another arm."""
    arm = place_in_cell(scenario, robot)
    scenario.pushes = pushes_on_links(scenario, arm, scenario.pushes)


def build(scenario: ContactAloneScenario, meshcat: Meshcat | None = None) -> ContactSetup:
    """Build the diagram of a scenario, with its recorders."""
    return build_contact(scenario, scenario.pushes, record, meshcat)


def record(recorder: Recorder, parts: ContactCell) -> None:
    """Record what is learned of the model's error."""
    learned = parts.pipeline.model_error
    for name, unit in (
        ("torque_external", "Nm"), ("torque_uncertainty", "Nm"), ("model_torque", "Nm"),
        ("learning_status", "LearningStatus"),
    ):  # fmt: skip
        recorder.add(f"model_{name}", learned.GetOutputPort(name), unit)


def judged(setup: ContactSetup, log: Log) -> list[Metric]:
    """Return how far the tip went, and how long somebody was felt."""
    robot = setup.robot
    tip = np.array([robot.kinematics(q).position(robot.n - 1, TIP) for q in log["position"]])
    way = np.linalg.norm(tip - tip[0], axis=1)
    felt, mode = log["contact"][:, 0] > 0.5, log["mode"][:, 0]
    wanted = InteractionMode.STOP if setup.scenario.case == "blind" else InteractionMode.HOLD
    return [
        Metric("tip_way_m", float(way.max()), "m", high=0.005),
        Metric("tip_way_after_a_second_m", float(way[log.time > 1.0].max()), "m"),
        Metric("false_contact_share", float(felt.mean()), "1", high=0.001),
        Metric("mode_at_the_end_right", float(mode[-1] == wanted), "1", low=1.0),
        Metric("model_torque_max_Nm", float(np.abs(log["model_model_torque"][-1]).max()), "Nm"),
    ]


def build_diagram(scenario: ContactAloneScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return build(scenario).diagram


def run(scenario: ContactAloneScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    return run_contact(build(scenario, options.meshcat), options, judged, figure, replay)


def figure(setup: ContactSetup, log: Log) -> Figure:
    """Return what the observer sees, what is learned, and what is left."""
    return time_panels(
        log,
        [
            Panel("Residual of the model", ["residual"], "r [Nm]"),
            Panel("Learned: gravity that the model lacks", ["model_model_torque"], "Δg [Nm]"),
            Panel("Residual that is left", ["model_torque_external"], "r [Nm]"),
            Panel("How far it may be from zero though nobody touches", ["model_torque_uncertainty"], "δr [Nm]"),
        ],
        f"Nobody near: {CASES[setup.scenario.case]}",
    )


def replay(setup: ContactSetup, log: Log, path: Path) -> None:
    """Write the run as a page that plays offline."""
    replay_contact(setup.parts.cell, log, path, f"Nobody near: {setup.scenario.case}")


EXPERIMENT = Experiment(
    "contact_alone",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=adapt,
    parts=lambda case: (*ARM, "camera"),
    quick=lambda scenario: shorten(scenario, 4.0),
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
