"""A person touches the arm: felt, found and answered by an impedance at the contact (Section 7, Fig. 12 and 13)."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

from experiments.contact.cell import ContactCell
from experiments.contact.impedance_judge import judged
from experiments.contact.random_run import run_random, trial_of
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
from experiments.trials import RandomTrials
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram

from saphari_drake.messages import InteractionMode
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.people.recorded_push import RecordedPushParameters, recorded_push
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions
from saphari_drake.simulation.view.figures import DARK, Line, Panel, Shade, intervals, time_panels

CASES = {
    "natural": "natural contact inertia, eq. (57); pushes on links 4, 5 and 6",
    "modified": "contact inertia diag(20, 3, 10) kg; pushes on link 6 along X, Y and Z, hand released",
    "recorded": "natural inertia; link 6 is pushed with the recorded force of a real person",
    "random": "natural inertia; random postures, links, points, directions, forces and fingers, seen and hidden",
}
SYNTHETIC = Path(__file__).parent / "data" / "hand_guiding_force.csv"


@dataclass
class ContactImpedanceScenario(ContactScenario, RandomTrials):
    """Everything a run depends on; the recorded case ends with its recording if that is earlier than `duration`."""

    case: str = "natural"
    recording: RecordedPushParameters = field(default_factory=RecordedPushParameters)
    trials: int = 20
    touches: RandomTouchParameters = field(default_factory=RandomTouchParameters)


def scenario_for(case: str) -> ContactImpedanceScenario:
    """Return the scenario of a case."""
    scenario = ContactImpedanceScenario(case=case)
    pipeline, hand = scenario.system.pipeline, scenario.system.cell.hand
    # One set for all cases. The modified inertia needs the fast observer, whose lag at the release acts as an impulse;
    # the recorded force the firm arm: a ball turns away under a soft one when the force leaves its centre.
    pipeline.observer.gain = 150.0
    hand.stiffness, hand.damping = 1500.0, 40.0
    # Along X the camera looks from behind the hand: the finger comes from the side, so that it is seen.
    sideways = [0.3, -0.7, -0.65]
    if case == "natural":
        scenario.pushes = [
            Push("link_4", [0.0, 0.0, 0.12], [0.0, 0.0, -1.0], [], 30.0, 1.0, 2.7),
            Push("link_5", [0.0, 0.0, 0.10], [1.0, 0.0, 0.0], sideways, 30.0, 7.0, 2.7),
            Push("link_6", [0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [], 30.0, 12.5, 2.7),
        ]
    elif case == "modified":
        pipeline.controller.M_d = [20.0, 3.0, 10.0]
        scenario.pushes = [
            Push("link_6", [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], sideways, 30.0, 1.0, 3.5),
            Push("link_6", [0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [], 30.0, 7.0, 3.0),
            Push("link_6", [0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [], 30.0, 12.5, 3.0),
        ]
    elif case == "recorded":
        scenario.duration = 60.0
        scenario.pushes = [Push("link_6", [0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [], 30.0, 0.3, 60.0)]
    return scenario


def adapt(scenario: ContactImpedanceScenario, robot: RobotModel) -> None:
    """Fit a scenario to another arm."""
    arm = place_in_cell(scenario, robot)
    if scenario.case == "random":
        scenario.touches.links = [robot.link_names[link] for link in touchable(arm)]
    elif scenario.case == "modified":
        scenario.pushes = pushes_along(scenario, arm, scenario.pushes)
    else:
        scenario.pushes = pushes_on_links(scenario, arm, scenario.pushes)


def build(scenario: ContactImpedanceScenario, meshcat: Meshcat | None = None) -> ContactSetup:
    """Build the diagram of a scenario, with its recorders."""
    pushes, recorded = aimed(scenario.pushes, scenario.seed, scenario.aim_spread), None
    if scenario.case == "recorded":
        given, push = scenario.recording, pushes[0]
        recorded = recorded_push(given.read(SYNTHETIC), push.direction, given)
        push.force, push.hold = recorded.bias, recorded.end + 0.3
    setup = build_contact(scenario, pushes, record, meshcat, recorded)
    if recorded is not None:
        setup.duration = min(setup.duration, pushes[0].start + pushes[0].hold + 1.5)
    return setup


def record(recorder: Recorder, parts: ContactCell) -> None:
    """Record what the impedance control tells beside all contact controllers."""
    recorder.add("position_error", parts.pipeline.controller.GetOutputPort("position_error"), "m")


def build_diagram(scenario: ContactImpedanceScenario) -> Diagram:
    """Return the diagram of a scenario; of random touches that of the first one."""
    if scenario.case == "random":
        scenario = trial_of(scenario, scenario.numbers[0]).scenario
    return build(scenario).diagram


def run(scenario: ContactImpedanceScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    if scenario.case == "random":
        return run_random(scenario, options, build, figure, replay, f"Contact impedance, {CASES['random']}")
    return run_contact(build(scenario, options.meshcat), options, judged, figure, replay)


def figure(setup: ContactSetup, log: Log) -> Figure:
    """Return the figure laid out as Fig. 12 or 13 of the deliverable."""
    axes = "XYZ"
    force = [Line("contact_force", i, f"F̂ {axes[i]}") for i in range(3)]
    truth = [Line("contact_truth", i, f"F {axes[i]} (true)", DARK[i], ":") for i in range(3)]
    number = "13" if setup.scenario.case == "modified" else "12"
    return time_panels(
        log,
        [
            Panel("Residual", ["residual"], "r [Nm]"),
            Panel("Contact force: estimate and truth", force + truth, "F [N]"),
            Panel("Contact position error", [Line("position_error", scale=1e3)], "e [mm]"),
        ],
        f"Contact impedance, {CASES[setup.scenario.case]}\n(layout of Fig. {number})",
        Shade(intervals(log.time, log["mode"][:, 0] == InteractionMode.CONTACT), "in contact"),
    )


def replay(setup: ContactSetup, log: Log, path: Path) -> None:
    """Write the run as a page that plays offline."""
    title = f"Contact impedance: {setup.scenario.case} (blue: estimated, green: true)"
    replay_contact(setup.parts.cell, log, path, title)


EXPERIMENT = Experiment(
    "contact_impedance",
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
