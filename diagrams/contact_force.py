"""A person touches the arm, which keeps the force of the contact at 15 N (Section 7, Fig. 15 and 16)."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from experiments.contact.cell import ContactCell
from experiments.contact.force_judge import CONTROLLED, judged
from experiments.contact.force_trials import PANELS, force_trial, force_trial_metrics, run_force_trial
from experiments.contact.random_touches import RandomTouchParameters
from experiments.contact.run import (
    ContactScenario,
    ContactSetup,
    aimed,
    build_contact,
    quick,
    replay_contact,
    run_contact,
)
from experiments.placement.contact import place_in_cell, pushes_along, pushes_on_links, touchable
from experiments.trials import RandomTrials, run_trials
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from saphari_drake.control.contact.gate import ForceStatus
from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions
from saphari_drake.simulation.view.figures import Line, Panel, Shade, intervals, time_panels

CASES = {
    "drift": "15 N along a fixed Y: regulated while the person pushes along Y, drift cut off when along X",
    "compatible": "15 N along the estimated force; pushes on links 3, 5 and 6 in turn",
    "random": "the same in random postures, on random links and points, from random directions",
}
# N/m and Ns/m; a hand that resists, as a person's arm does.
STIFFNESS, DAMPING = 100.0, 20.0


def resisting(
    link: str, aim: list[float], direction: list[float], finger: list[float], start: float, hold: float, depth: float
) -> Push:
    """Return the push of a hand that goes as deep past the surface (m) and resists there like a spring."""
    return Push(link, aim, direction, finger, 40.0, start, hold, depth, 0.1, STIFFNESS, DAMPING)


@dataclass
class ContactForceScenario(ContactScenario, RandomTrials):
    """Everything a run depends on."""

    case: str = "compatible"
    # Random touches: how they are drawn, by what hand, and m, how far past the surface it leans in, [low, high].
    touches: RandomTouchParameters = field(
        default_factory=lambda: RandomTouchParameters(["link_3", "link_5", "link_6"], hold=4.5)
    )
    hand: Push = field(default_factory=lambda: resisting("link_6", [0.0] * 3, [0.0, -1.0, 0.0], [], 0.3, 4.5, 0.15))
    depths: list[float] = field(default_factory=lambda: [0.14, 0.2])


def scenario_for(case: str) -> ContactForceScenario:
    """Return the scenario of a case."""
    scenario = ContactForceScenario(case=case)
    pipeline = scenario.system.pipeline
    control = ContactForceControlParameters(hand_stiffness=STIFFNESS, hand_damping=DAMPING)
    pipeline.controller = control
    pipeline.observer.gain = 100.0
    # Nothing is to return: the robot stays where it is released.
    pipeline.monitor.return_timeout = 0.3
    # A hand that is no longer seen has left, also if the residual does not say so.
    pipeline.monitor.unseen_time = 0.15
    if case == "compatible":
        scenario.duration = 23.0
        scenario.pushes = [
            resisting("link_3", [0.0, 0.0, 0.1], [1.0, 0.0, -0.3], [0.5, 0.6, -0.6], 0.5, 6.0, 0.2),
            resisting("link_5", [0.0, 0.0, 0.08], [1.0, 0.0, 0.0], [0.3, -0.7, -0.65], 8.0, 6.0, 0.2),
            resisting("link_6", [0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [], 15.5, 6.0, 0.15),
        ]
    elif case == "drift":
        scenario.duration = 12.5
        control.direction, control.fixed_force = "fixed", [0.0, 15.0, 0.0]
        scenario.home[0] = -90.0
        # The whole force comes at once; a slower change of law keeps it from stopping the robot where it is resisted.
        pipeline.switch.transition_time = 0.3
        scenario.pushes = [
            resisting("link_6", [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [], 0.5, 6.0, 0.15),
            resisting("link_6", [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 0.7, -0.65], 8.0, 3.5, 0.2),
        ]
    return scenario


def adapt(scenario: ContactForceScenario, robot: RobotModel) -> None:
    """Fit a scenario to another arm."""
    arm = place_in_cell(scenario, robot)
    if scenario.case == "random":
        scenario.touches.links = [robot.link_names[link] for link in touchable(arm)]
        return
    if scenario.case == "compatible":
        scenario.pushes = pushes_on_links(scenario, arm, scenario.pushes)
        return
    # The first push is resisted along the desired force, the other one is across it.
    control, place = scenario.system.pipeline.controller, pushes_along(scenario, arm, scenario.pushes, 2)
    scenario.pushes = place
    size = float(np.linalg.norm(control.fixed_force))
    control.fixed_force = (size * np.asarray(place[0].direction)).tolist()


def build(scenario: ContactForceScenario, meshcat: Meshcat | None = None) -> ContactSetup:
    """Build the diagram of a scenario, with its recorders."""
    pushes = aimed(scenario.pushes, scenario.seed, scenario.aim_spread)
    return build_contact(scenario, pushes, record, meshcat)


def record(recorder: Recorder, parts: ContactCell) -> None:
    """Record what the force control tells beside all contact controllers."""
    controller = parts.pipeline.controller
    recorder.add("unobservable", parts.pipeline.force.GetOutputPort("unobservable_directions"), "1")
    recorder.add("transition", parts.pipeline.switch.GetOutputPort("transition"), "Nm")
    recorder.add("force_status", controller.GetOutputPort("force_status"), "ForceStatus")
    units = {"desired_force": "N", "force_error": "N", "contact_velocity": "m/s", "stop_velocity": "m/s"}
    for name, unit in units.items():
        recorder.add(name, controller.GetOutputPort(name), unit)


def build_diagram(scenario: ContactForceScenario) -> Diagram:
    """Return the diagram of a scenario; of random touches that of the first one."""
    if scenario.case == "random":
        scenario = force_trial(scenario, scenario.numbers[0])
    return build(scenario).diagram


def run(scenario: ContactForceScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    if scenario.case == "random":
        return run_trials(
            scenario,
            lambda number, label: run_force_trial(scenario, number, build, figure, replay, options, label),
            lambda columns: force_trial_metrics(columns, scenario.system.pipeline.controller.speed_limit),
            PANELS,
            f"Contact force control, {CASES['random']}",
        )
    return run_contact(build(scenario, options.meshcat), options, judged, figure, replay)


def figure(setup: ContactSetup, log: Log) -> Figure:
    """Return the figure laid out as Fig. 15 or 16 of the deliverable."""
    log.add("force_norm", np.linalg.norm(log["contact_force"], axis=1), "N")
    log.add("force_norm_true", np.linalg.norm(log["contact_truth"][:, :3], axis=1), "N")
    drift = setup.scenario.case == "drift"
    limit = setup.scenario.system.pipeline.controller.speed_limit
    force = [Line("force_norm", label="‖F̂‖"), Line("force_norm_true", label="‖F‖ (true)", color="black", style=":")]
    status = log["force_status"][:, 0]
    return time_panels(
        log,
        [
            Panel("Residual", ["residual"], "r [Nm]"),
            Panel("Modulus of the contact force", force, "F [N]", {"15 N": 15.0}),
            Panel("Contact velocity", ["contact_velocity"], "v [m/s]", {"limit": limit, "": -limit}),
        ],
        f"Contact force control, {CASES[setup.scenario.case]} (layout of Fig. {15 if drift else 16})",
        [
            Shade(intervals(log.time, np.isin(status, CONTROLLED)), "force controlled"),
            Shade(intervals(log.time, status == ForceStatus.SPEED_STOP), "speed stop", "#CC79A7"),
        ],
    )


def replay(setup: ContactSetup, log: Log, path: Path) -> None:
    """Write the run as a page that plays offline."""
    title = f"Contact force: {setup.scenario.case} (blue: estimated, green: true)"
    if setup.scenario.case == "drift":
        camera = (-1.3, -1.5, 1.2), (0.0, -0.35, 0.5)
    else:
        camera = (-1.3, 1.5, 1.2), (0.0, 0.35, 0.5)
    replay_contact(setup.parts.cell, log, path, title, camera=camera)


EXPERIMENT = Experiment(
    "contact_force",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=adapt,
    parts=lambda case: (*ARM, "camera", "person"),
    quick=quick,
)


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
