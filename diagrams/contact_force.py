"""A person touches the arm, which keeps the force of the contact at 15 N (Section 7, Fig. 15 and 16)."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from experiments.contact import force_judge as judge
from experiments.contact import judge as touches_of
from experiments.contact.cell import ContactCell, add_contact_cell
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
from pydrake.systems.framework import Diagram, DiagramBuilder

from saphari_drake.control.contact.force_parameters import ContactForceControlParameters
from saphari_drake.control.contact.stability import hand_stiffness_limits
from saphari_drake.robots import catalog
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.experiment import Experiment, Log, Metric, Outcome, RunOptions, main
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.view.figures import Line, Panel, Shade, intervals, time_panels

CASES = {
    "drift": "15 N along a fixed Y: regulated while the person pushes along Y, drift cut off when along X",
    "compatible": "15 N along the estimated force; pushes on links 3, 5 and 6 in turn",
}
# N/m and Ns/m; a hand that resists, as a person's arm does.
STIFFNESS, DAMPING = 100.0, 20.0


@dataclass
class ContactForceScenario(ContactScenario):
    """Everything a run depends on."""

    case: str = "compatible"


def resisting(
    link: str, aim: list[float], direction: list[float], finger: list[float], start: float, hold: float, depth: float
) -> Push:
    """Return the push of a hand that goes as deep past the surface (m) and resists there like a spring."""
    return Push(link, aim, direction, finger, 40.0, start, hold, depth, 0.1, STIFFNESS, DAMPING)


def scenario_for(case: str) -> ContactForceScenario:
    """Return the scenario of a case."""
    scenario = ContactForceScenario(case=case)
    pipeline = scenario.system.pipeline
    control = ContactForceControlParameters(hand_stiffness=STIFFNESS, hand_damping=DAMPING)
    pipeline.controller = control
    pipeline.observer.gain = 100.0
    # Nothing is to return: the robot stays where it is released.
    pipeline.monitor.return_timeout = 0.3
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
        control.transition_time = 0.3
        scenario.pushes = [
            resisting("link_6", [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [], 0.5, 6.0, 0.15),
            resisting("link_6", [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 0.7, -0.65], 8.0, 3.5, 0.2),
        ]
    return scenario


@dataclass
class Setup:
    """A diagram and what is needed to run and judge it."""

    scenario: ContactForceScenario
    robot: RobotModel
    pushes: list[Push]
    diagram: Diagram
    parts: ContactCell
    recorder: Recorder
    fine: Recorder


def build(scenario: ContactForceScenario, meshcat: Meshcat | None = None) -> Setup:
    """Build the diagram of a scenario, with its recorder."""
    robot = catalog.load(scenario.robot, home=np.deg2rad(scenario.home))
    pushes = aimed(scenario.pushes, scenario.seed, scenario.aim_spread)
    scenario.system.sampler.noise.seed = scenario.seed
    builder = DiagramBuilder()
    parts = add_contact_cell(builder, robot, pushes, scenario.system)
    recorder = record_contact(builder, parts, scenario.system.pipeline.joint_sensor.period)
    controller = parts.pipeline.controller
    hidden = parts.pipeline.force.GetOutputPort("unobservable_directions")
    recorder.add("unobservable", hidden, "1")
    recorder.add("transition", controller.GetOutputPort("torque_terms"), "Nm", lambda terms: terms[-robot.n :])
    recorder.add("desired_force", controller.GetOutputPort("desired_force"), "N")
    recorder.add("force_error", controller.GetOutputPort("force_error"), "N")
    recorder.add("contact_velocity", controller.GetOutputPort("contact_velocity"), "m/s")
    recorder.add("force_status", controller.GetOutputPort("force_status"), "ForceStatus")
    fine = record_velocity(builder, parts)
    recorder.add("stop_velocity", controller.GetOutputPort("stop_velocity"), "m/s")
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, parts.cell.scene_graph, meshcat)
    return Setup(scenario, robot, pushes, builder.Build(), parts, recorder, fine)


def build_diagram(scenario: ContactForceScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return build(scenario).diagram


def run(scenario: ContactForceScenario, options: RunOptions) -> Outcome:
    """Run a scenario and judge it."""
    setup = build(scenario, options.meshcat)
    simulator, depth, wall = simulate(
        setup.diagram, setup.parts, setup.pushes, scenario.duration, scenario.case, options
    )
    log = setup.recorder.log(setup.diagram, simulator.get_context())
    fine = setup.fine.log(setup.diagram, simulator.get_context())
    metrics = judged(setup, log) + limit_metrics(setup.robot, fine["velocity_1ms"], log["torque_excess"])
    metrics += timing(setup.robot, scenario.system, log, depth, scenario.duration, wall)
    return Outcome(metrics, log, lambda: figure(setup, log), lambda path: replay(setup, log, path))


def judged(setup: Setup, log: Log) -> list[Metric]:
    """Return the metrics of the contract, and those that explain them."""
    robot, pipeline = setup.robot, setup.scenario.system.pipeline
    control, K_I = pipeline.controller, float(np.min(pipeline.observer.gain))
    touches = touches_of.find_touches(log, robot, setup.pushes)
    speed = np.linalg.norm(judge.true_velocity(log, robot), axis=1)
    metrics = (
        drift_metrics(setup, log, touches)
        if control.direction == "fixed"
        else force_metrics(log, touches, control.desired_force)
    )
    still = max(judge.motion(log, robot, rows) for rows in judge.untouched(log))
    jump = np.abs(np.diff(log["torque"], axis=0)).max()
    return [
        *metrics,
        Metric("motion_without_touch_m", still, "m", high=0.001, reported="at rest"),
        Metric("max_speed", float(speed.max()), "m/s", high=control.speed_limit),
        # Below the stated stiffness of the hand, force control can oscillate with it, and a warning says so.
        Metric(
            "hand_stiffness_limit",
            float(hand_stiffness_limits(control, K_I).min()),
            "N/m",
            low=control.hand_stiffness,
            decides=False,
        ),
        # A push that grows slowly where its lever is short is felt late: the detector's threshold is 1 Nm.
        *touches_of.localization_metrics(log, touches, answered=False),
        Metric("torque_step_max_Nm", float(jump), "Nm"),
    ]


def force_metrics(log: Log, touches: list[touches_of.Touch], desired: float) -> list[Metric]:
    """Return the error of the contact force's size (N), and the size in each touch.

    On links 1 to 3 joint torques show a part of the force alone. That part is controlled, and decides; the whole force
    stands beside it.
    """
    metrics, errors, whole_errors = [], [], []
    for touch in touches:
        shown, whole, estimated = judge.steady_norms(log, touch)
        errors.append(abs(shown - desired))
        whole_errors.append(abs(whole - desired))
        name = touch.push.link
        metrics.append(Metric(f"force_norm_{name}_N", shown, "N", reported="15 N"))
        if abs(whole - shown) > 0.01:
            metrics.append(Metric(f"force_norm_{name}_with_unobservable_N", whole, "N"))
        metrics.append(Metric(f"force_estimate_norm_{name}_N", estimated, "N"))
    return [
        Metric("force_norm_error_N", float(np.max(errors)), "N", high=0.5, reported="about 1 N"),
        Metric("force_norm_error_whole_N", float(np.max(whole_errors)), "N", high=0.5, decides=False),
        *metrics,
    ]


def drift_metrics(setup: Setup, log: Log, touches: list[touches_of.Touch]) -> list[Metric]:
    """Return the error of the force that is resisted, and the drift along the one that is not."""
    control = setup.scenario.system.pipeline.controller
    wanted = np.array(control.fixed_force)
    unit, size = wanted / np.linalg.norm(wanted), float(np.linalg.norm(wanted))
    rows = touches_of.steady(log, touches[0])
    held = float((log["contact_truth"][rows, :3] @ unit).mean())
    drift = judge.find_drift(log, setup.robot, touches[1])
    velocity, expected = drift.velocity[-1], judge.expected_drift(log, setup.robot, drift, control)
    time = float(log.time[drift.rows[-1]] - log.time[drift.rows[0]])
    axis = int(np.argmax(np.abs(unit)))
    K_f, K_d = np.broadcast_to(control.K_f, 3)[axis], np.broadcast_to(control.K_d, 3)[axis]
    cosine = velocity @ expected / (np.linalg.norm(velocity) * np.linalg.norm(expected))
    metrics = [
        Metric("force_along_desired_error_N", abs(held - size), "N", high=0.5, reported="regulated"),
        Metric("drift_speed", -velocity @ unit, "m/s", low=0.0, reported="drifts against F_d"),
        Metric("drift_speed_expected", -expected @ unit, "m/s"),
        Metric("drift_speed_error_relative", abs((velocity @ unit) / (expected @ unit) - 1.0), "1", high=0.1),
        Metric("drift_direction_error_rad", float(np.arccos(min(cosine, 1.0))), "rad", high=0.2),
        Metric("drift_time_s", time, "s"),
        Metric("drift_stopped", float(drift.stopped), "1", 1.0, 1.0),
    ]
    if len(control.M_d):
        free = judge.free_drift_speed(size, K_f, K_d, control.M_d[axis], np.array(time))
        metrics.append(Metric("drift_speed_without_transition", free, "m/s"))
    return metrics


def figure(setup: Setup, log: Log):
    """Return the figure laid out as Fig. 15 or 16 of the deliverable."""
    log.add("force_norm", np.linalg.norm(log["contact_force"], axis=1), "N")
    log.add("force_norm_true", np.linalg.norm(log["contact_truth"][:, :3], axis=1), "N")
    drift = setup.scenario.case == "drift"
    limit = setup.scenario.system.pipeline.controller.speed_limit
    force = [Line("force_norm", label="‖F̂‖"), Line("force_norm_true", label="‖F‖ (true)", color="black", style=":")]
    stopped = log["force_status"][:, 0] == 5
    return time_panels(
        log,
        [
            Panel("Residual", ["residual"], "r [Nm]"),
            Panel("Modulus of the contact force", force, "F [N]", {"15 N": 15.0}),
            Panel("Contact velocity", ["contact_velocity"], "v [m/s]", {"limit": limit, "": -limit}),
        ],
        f"Contact force control, {CASES[setup.scenario.case]} (layout of Fig. {15 if drift else 16})",
        [
            Shade(intervals(log.time, np.isin(log["force_status"][:, 0], (1, 2))), "force controlled"),
            Shade(intervals(log.time, stopped), "speed stop", "#CC79A7"),
        ],
    )


def replay(setup: Setup, log: Log, path: Path) -> None:
    """Write the run as a page that plays offline."""
    title = f"Contact force: {setup.scenario.case} (blue: estimated, green: true)"
    if setup.scenario.case == "drift":
        camera = (-1.3, -1.5, 1.2), (0.0, -0.35, 0.5)
    else:
        camera = (-1.3, 1.5, 1.2), (0.0, 0.35, 0.5)
    replay_contact(setup.robot, setup.scenario.system, log, path, title, camera=camera)


EXPERIMENT = Experiment(
    name="contact_force",
    summary=__doc__,
    cases=CASES,
    scenario_for=scenario_for,
    run=run,
    build_diagram=build_diagram,
    accepts_model=True,
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
