"""A person touches the arm: felt, found and answered by an impedance at the contact (Section 7, Fig. 12 and 13)."""

import sys
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from experiments.contact import judge, random_run
from experiments.contact.cell import ContactCell, add_contact_cell
from experiments.contact.random_touches import RandomTouch, RandomTouchParameters, draw_touch
from experiments.contact.run import (
    ContactScenario,
    aimed,
    record_contact,
    record_velocity,
    replay_contact,
    simulate,
    timing,
)
from pydrake.geometry import Meshcat, MeshcatVisualizer
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from saphari_drake.parameters import require_positive
from saphari_drake.robots import catalog
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.force_recording import read_force_recording
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.people.recorded_push import RecordedPush, RecordedPushParameters, recorded_push
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.command_line import say
from saphari_drake.simulation.runner.experiment import Experiment, Log, Metric, Outcome, RunOptions, main
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.view.figures import Line, Panel, Shade, intervals, time_panels
from saphari_drake.simulation.world.cell import contact_truth

CASES = {
    "natural": "natural contact inertia, eq. (57); pushes on links 4, 5 and 6",
    "modified": "contact inertia diag(20, 3, 10) kg; pushes on link 6 along X, Y and Z, hand released",
    "recorded": "natural inertia; link 6 is pushed with the recorded force of a real person",
    "random": "natural inertia; random postures, links, points, directions, forces and fingers, seen and hidden",
}
SYNTHETIC = Path(__file__).parent / "data" / "hand_guiding_force.csv"


@dataclass
class ContactImpedanceScenario(ContactScenario):
    """Everything a run depends on; the recorded case ends with its recording if that is earlier than `duration`."""

    case: str = "natural"
    recording: RecordedPushParameters = field(default_factory=RecordedPushParameters)
    # Number of random touches (≥ 1), and the one to run alone (−1: all); touch k of a seed is the same everywhere.
    trials: int = 20
    trial: int = -1
    touches: RandomTouchParameters = field(default_factory=RandomTouchParameters)

    def __post_init__(self) -> None:
        require_positive(self, "trials")


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


@dataclass
class Setup:
    """A diagram and what is needed to run and judge it."""

    scenario: ContactImpedanceScenario
    robot: RobotModel
    pushes: list[Push]
    diagram: Diagram
    parts: ContactCell
    recorder: Recorder
    fine: Recorder
    recorded: RecordedPush | None
    duration: float


def build(scenario: ContactImpedanceScenario, meshcat: Meshcat | None = None) -> Setup:
    """Build the diagram of a scenario, with its recorder."""
    robot = catalog.load(scenario.robot, home=np.deg2rad(scenario.home))
    pushes = aimed(scenario.pushes, scenario.seed, scenario.aim_spread)
    scenario.system.sampler.noise.seed = scenario.seed
    recorded, duration = None, scenario.duration
    if scenario.case == "recorded":
        given = scenario.recording
        source = read_force_recording(given.file or SYNTHETIC, index=given.index, rate=given.rate or None)
        recorded = recorded_push(source, pushes[0].direction, given)
        pushes[0].force = recorded.bias
        pushes[0].hold = recorded.end + 0.3
        duration = min(duration, pushes[0].start + pushes[0].hold + 1.5)
    builder = DiagramBuilder()
    profile = recorded.profile if recorded else None
    parts = add_contact_cell(builder, robot, pushes, scenario.system, profile)
    recorder = record(builder, parts, scenario.system.pipeline.joint_sensor.period)
    fine = record_velocity(builder, parts)
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, parts.cell.scene_graph, meshcat)
    return Setup(scenario, robot, pushes, builder.Build(), parts, recorder, fine, recorded, duration)


def build_diagram(scenario: ContactImpedanceScenario) -> Diagram:
    """Return the diagram of a scenario; of random touches that of the first one."""
    if scenario.case == "random":
        scenario = trial_of(scenario, drawn_touch(scenario, max(scenario.trial, 0)), max(scenario.trial, 0))
    return build(scenario).diagram


def record(builder: DiagramBuilder, parts: ContactCell, period: float) -> Recorder:
    """Record what the figures and the judgement need, once a cycle."""
    recorder = record_contact(builder, parts, period)
    recorder.add("position_error", parts.pipeline.controller.GetOutputPort("position_error"), "m")
    return recorder


def drawn_touch(scenario: ContactImpedanceScenario, trial: int) -> RandomTouch:
    """Return the random touch of a trial."""
    robot = catalog.load(scenario.robot, home=np.deg2rad(scenario.home))
    return draw_touch(robot, scenario.system.cell.hand, scenario.touches, [scenario.seed, trial])


def trial_of(scenario: ContactImpedanceScenario, drawn: RandomTouch, trial: int) -> ContactImpedanceScenario:
    """Return the scenario of one random touch."""
    single = deepcopy(scenario)
    single.home = drawn.home
    single.pushes, single.aim_spread = [drawn.push], 0.0
    single.duration = drawn.push.start + drawn.push.hold + scenario.touches.watched + 0.2
    single.system.cell.hand.finger_radius = drawn.finger_radius
    single.seed = scenario.seed + 1000 * trial  # of the camera's noise
    return single


def run_trial(
    scenario: ContactImpedanceScenario, trial: int, options: RunOptions
) -> tuple[random_run.JudgedTouch, Setup, Log]:
    """Run and judge one random touch."""
    drawn = drawn_touch(scenario, trial)
    setup = build(trial_of(scenario, drawn, trial), options.meshcat)
    simulator = Simulator(setup.diagram)
    simulator.set_target_realtime_rate(options.realtime_rate)
    push = drawn.push
    simulator.AdvanceTo(push.start + push.hold - 0.1)
    truth = contact_truth(
        setup.parts.cell.plant.get_contact_results_output_port().Eval(
            setup.parts.cell.plant.GetMyContextFromRoot(simulator.get_context())
        ),
        setup.parts.cell,
    )
    seen = random_run.is_seen(setup.parts, simulator, setup.robot, truth[3:6])
    simulator.AdvanceTo(setup.duration)
    log = setup.recorder.log(setup.diagram, simulator.get_context())
    fine = setup.fine.log(setup.diagram, simulator.get_context())
    K_p = np.broadcast_to(scenario.system.pipeline.controller.K_p, 3)
    watched = scenario.touches.watched
    return random_run.judged_touch(setup.robot, trial, drawn, log, fine, seen, K_p, watched), setup, log


def run_random(scenario: ContactImpedanceScenario, options: RunOptions) -> Outcome:
    """Run random touches and judge each; the replay shows the worst of them."""
    trials = [scenario.trial] if scenario.trial >= 0 else list(range(scenario.trials))
    touches, worst = [], None
    for k, trial in enumerate(trials):
        touch, setup, log = run_trial(scenario, trial, options)
        touches.append(touch)
        if worst is None or (touch.meets_all, -touch.wander) < (worst[0].meets_all, -worst[0].wander):
            worst = touch, setup, log
        random_run.show_progress(k + 1, len(trials), sum(t.meets_all for t in touches))
    failed = random_run.failures(worst[1].robot, touches, scenario.seed)
    if failed:
        say(failed)
    log = random_run.touch_log(touches)
    return Outcome(
        random_run.random_metrics(touches),
        log,
        lambda: random_run.figure(worst[1].robot, log, f"Contact impedance, {CASES['random']}"),
        lambda path: replay(worst[1], worst[2], path),
    )


def run(scenario: ContactImpedanceScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    if scenario.case == "random":
        return run_random(scenario, options)
    setup = build(scenario, options.meshcat)
    simulator, depth, wall = simulate(setup.diagram, setup.parts, setup.pushes, setup.duration, scenario.case, options)
    log = setup.recorder.log(setup.diagram, simulator.get_context())
    fine = setup.fine.log(setup.diagram, simulator.get_context())
    metrics = judged(setup, log) + limit_metrics(setup.robot, fine["velocity_1ms"], log["torque_excess"])
    metrics += timing(setup.robot, scenario.system, log, depth, setup.duration, wall)
    return Outcome(metrics, log, lambda: figure(setup, log), lambda path: replay(setup, log, path))


def judged(setup: Setup, log: Log) -> list[Metric]:
    """Return the metrics of the contract, and those that explain them."""
    robot, case = setup.robot, setup.scenario.case
    touches = judge.find_touches(log, robot, setup.pushes)
    K_p = np.broadcast_to(setup.scenario.system.pipeline.controller.K_p, 3)
    metrics = []
    if case == "recorded":
        metrics += recorded_metrics(setup, log)
    else:
        worst = max(judge.force_error(log, touch) for touch in touches)
        metrics.append(Metric("force_error_relative", worst, "1", high=0.10, reported="estimate used as it is"))
    metrics += judge.localization_metrics(log, touches, 0.010, 0.015)
    if case != "recorded":
        worst = max(judge.deflection_error(log, robot, touch, K_p) for touch in touches)
        metrics.append(Metric("deflection_error_relative", worst, "1", high=0.10, reported="F/K_p, eq. (53)"))
    delays = [judge.detection_delay(log, touch) for touch in touches]
    bound = 0.05 if case == "natural" else np.inf
    metrics.append(Metric("contact_detection_delay_s", float(np.max(delays)), "s", high=bound))
    if case == "modified":
        metrics += return_metrics(setup, log, touches)
    jump = np.abs(np.diff(log["torque"], axis=0)).max()
    metrics.append(Metric("torque_step_max_Nm", float(jump), "Nm"))
    return metrics


def return_metrics(setup: Setup, log: Log, touches: list[judge.Touch]) -> list[Metric]:
    """Return the return times of the modified inertia, with the ideal ones of the same axes beside them."""
    controller = setup.scenario.system.pipeline.controller
    K_p, K_d = np.broadcast_to(controller.K_p, 3), np.broadcast_to(controller.K_d, 3)
    metrics, times, errors = [], {}, []
    for touch in touches:
        axis = int(np.argmax(np.abs(touch.push.direction)))
        name = "xyz"[axis]
        times[name] = judge.return_time(log, setup.robot, touch)
        ideal = judge.second_order_return_time(controller.M_d[axis], K_d[axis], K_p[axis])
        errors.append(abs(times[name] / ideal - 1.0))
        reported = {"x": "slowest", "y": "fastest", "z": "between"}[name]
        metrics.append(Metric(f"return_time_{name}_s", times[name], "s", 0.85 * ideal, 1.15 * ideal, reported))
    ordered = float(times.get("y", np.nan) < times.get("z", np.nan) < times.get("x", np.nan))
    final = max(judge.position_error_final(log, setup.robot, touch) for touch in touches)
    return [
        *metrics,
        Metric("return_times_ordered", ordered, "1", 1.0, 1.0, "Y fastest, X slowest"),
        Metric("return_time_error_relative", float(np.max(errors)), "1", high=0.15),
        Metric("position_error_final_m", final, "m", high=0.002, reported="returns to the original position"),
    ]


def recorded_metrics(setup: Setup, log: Log) -> list[Metric]:
    """Return the errors along the recording, of the whole force and of its varying part."""
    start = setup.pushes[0].start
    rows = log.between(start + setup.recorded.start, start + setup.recorded.end)
    true, estimated = log["contact_truth"][rows, :3], log["contact_force"][rows]
    size, error = np.linalg.norm, estimated - true
    varying = size(error - error.mean(axis=0)) / size(true - true.mean(axis=0))
    return [
        Metric("force_error_rms_relative", size(error) / size(true), "1", high=0.15),
        Metric("force_error_rms_relative_varying", varying, "1"),
        Metric("force_rms_N", size(true) / np.sqrt(len(true)), "N"),
        Metric("force_bias_N", setup.recorded.bias, "N"),
        Metric("force_scale", setup.recorded.scale, "1"),
    ]


def figure(setup: Setup, log: Log):
    """Return the figure laid out as Fig. 12 or 13 of the deliverable."""
    axes = "XYZ"
    force = [Line("contact_force", i, f"F̂ {axes[i]}") for i in range(3)]
    truth = [Line("contact_truth", i, f"F {axes[i]} (true)", "black", ":") for i in range(3)]
    number = "13" if setup.scenario.case == "modified" else "12"
    return time_panels(
        log,
        [
            Panel("Residual", ["residual"], "r [Nm]"),
            Panel("Contact force: estimate and truth", force + truth, "F [N]"),
            Panel("Contact position error", [Line("position_error", scale=1e3)], "e [mm]"),
        ],
        f"Contact impedance, {CASES[setup.scenario.case]}\n(layout of Fig. {number})",
        Shade(intervals(log.time, log["mode"][:, 0] == 1), "in contact"),
    )


def replay(setup: Setup, log: Log, path: Path) -> None:
    """Write the run as a page that plays offline."""
    title = f"Contact impedance: {setup.scenario.case} (blue: estimated, green: true)"
    replay_contact(setup.robot, setup.scenario.system, log, path, title)


EXPERIMENT = Experiment(
    name="contact_impedance",
    summary=__doc__,
    cases=CASES,
    scenario_for=scenario_for,
    run=run,
    build_diagram=build_diagram,
    accepts_model=True,
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
