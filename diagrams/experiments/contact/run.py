"""What every experiment in the contact cell does alike: aim, build, record, run, time and replay."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder

from experiments.contact.cell import ContactCell, ContactCellParameters, add_contact_cell, learn_background
from experiments.contact.cycle_time import time_cycles
from saphari_drake.messages import InteractionMode
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.injection import inject_into
from saphari_drake.simulation.faults.people import FASTER
from saphari_drake.simulation.people.pushing_hand import HumanHand, Push
from saphari_drake.simulation.people.recorded_push import RecordedPush
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.record.robot import record_limits, record_robot
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, NothingToJudgeError, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.simulation.view.replay import Arrow, Marker, show, write_replay
from saphari_drake.simulation.world.cell import Cell, contact_truth

Array = NDArray[np.float64]
LONGEST, AFTER = 8.0, 2.5  # s; of a quick run, and what of it comes after the first push
BLUE, GREEN = (0.0, 0.25, 0.80), (0.0, 0.62, 0.45)
ARROW_SCALE = 0.008  # m/N


@dataclass
class ContactScenario(PlantScenario):
    """Everything that a run of the contact cell depends on; the seed is also of where the person aims."""

    duration: float = 18.0
    # deg; posture at the start. Empty: the model's own home posture, as it is with --model.
    home: list[float] = field(default_factory=lambda: [90.0, -30.0, 0.0, 60.0, 0.0, -90.0, 0.0])
    # m; the person misses the aimed point by up to this in each direction.
    aim_spread: float = 0.006
    pushes: list[Push] = field(default_factory=list)
    system: ContactCellParameters = field(default_factory=ContactCellParameters)


def aimed(pushes: Sequence[Push], seed: int, spread: float) -> list[Push]:
    """Return the pushes of a person who misses the aimed points by up to `spread` (m) in each direction."""
    offsets = np.random.default_rng(seed).uniform(-1.0, 1.0, (len(pushes), 3)) * spread
    return [replace(push, aim=list(np.add(push.aim, offset))) for push, offset in zip(pushes, offsets)]


def quick(scenario: Any) -> None:
    """Shorten a `ContactScenario` to its first push and what follows it, or to one trial."""
    pushes = scenario.pushes[:1]
    shorten(scenario, min([LONGEST, *(push.start + push.hold + AFTER for push in pushes)]))


@dataclass
class ContactSetup:
    """A diagram and what is needed to run and judge it."""

    scenario: Any
    robot: RobotModel
    pushes: list[Push]
    diagram: Diagram
    parts: ContactCell
    recorder: Recorder  # every cycle
    fast: Recorder  # every step of the plant
    duration: float  # s
    recorded: RecordedPush | None = None


def build_contact(
    scenario: Any,
    pushes: list[Push],
    record: Callable[[Recorder, ContactCell], None],
    meshcat: Meshcat | None = None,
    recorded: RecordedPush | None = None,
) -> ContactSetup:
    """Build the diagram of a `ContactScenario`; `record` adds to its recorder what this controller has."""
    robot = scenario.known(scenario.loaded(scenario.home), scenario.system.pipeline.observer)
    if "person_faster" in scenario.faults:
        pushes = [replace(push, speed=FASTER * (push.speed or HumanHand.SPEED)) for push in pushes]
    scenario.system.sampler.noise.seed = scenario.seed
    builder = DiagramBuilder()
    profile = recorded.profile if recorded else None
    truth = scenario.truth(scenario.system.period)
    parts = add_contact_cell(builder, robot, pushes, scenario.system, profile, truth)
    recorder = record_contact(builder, parts, scenario.system.pipeline.period)
    record(recorder, parts)
    fast = record_limits(builder, parts.cell, parts.pipeline.envelope.GetOutputPort("torque_excess"))
    inject_into(builder, parts.cell, truth)
    show(builder, parts.cell.scene_graph, meshcat)
    return ContactSetup(scenario, robot, pushes, builder.Build(), parts, recorder, fast, scenario.duration, recorded)


def record_contact(builder: DiagramBuilder, parts: ContactCell, period: float) -> Recorder:
    """Record, once a cycle, what the figures and the judgement of every controller need."""
    cell, p = parts.cell, parts.pipeline
    recorder = record_robot(builder, cell, period)
    recorder.add("residual", p.observer.GetOutputPort("torque_external"), "Nm")
    recorder.add("contact", p.detector.GetOutputPort("contact"), "1")
    recorder.add("mode", p.monitor.GetOutputPort("mode"), "InteractionMode")
    recorder.add("active_link", p.monitor.GetOutputPort("active_contact"), "index", lambda c: [c.link])
    recorder.add("camera_status", p.localizer.GetOutputPort("camera_status"), "CameraStatus")
    recorder.add("contact_force", p.force.GetOutputPort("contact_force"), "N")
    recorder.add("force_rank", p.force.GetOutputPort("rank"), "1")
    recorder.add("contact_position", p.controller.GetOutputPort("contact_position"), "m")
    recorder.add("torque", p.torque_output, "Nm")
    recorder.add("torque_excess", p.envelope.GetOutputPort("torque_excess"), "Nm")
    recorder.add("contact_truth", cell.contact_results, "N, m, index", lambda results: contact_truth(results, cell), 7)
    return recorder


def run_contact(
    setup: ContactSetup,
    options: RunOptions,
    judged: Callable[[ContactSetup, Log], list[Metric]],
    draw: Callable[[ContactSetup, Log], Figure],
    replay: Callable[[ContactSetup, Log, Path], None],
) -> Outcome:
    """Run a diagram and judge it by `judged`, by the joints' limits, and by the clock."""
    scenario, parts, first = setup.scenario, setup.parts, setup.pushes[0]
    run = Simulation(setup.diagram, scenario.case, options)
    context = run.to(min(first.start + min(first.hold, 2.5), setup.duration))
    depth = parts.sampler.GetOutputPort("depth_image").Eval(parts.sampler.GetMyContextFromRoot(context)).data[..., 0]
    frame = depth.copy()
    run.to(setup.duration)
    log, fast = run.log(setup.recorder), run.log(setup.fast)
    answers, note = [], ""
    try:
        answers = judged(setup, log)
    except NothingToJudgeError as error:
        note = str(error)
    metrics = [
        *answers,
        *limit_metrics(setup.robot, fast["velocity"], fast["torque_excess"]),
        *timing(setup.robot, scenario.system, log, frame),
        Metric("real_time_factor", run.real_time_factor, "1", 0.25, decides=False),
    ]
    return Outcome(metrics, log, lambda: draw(setup, log), lambda path: replay(setup, log, path), note=note)


def timing(robot: RobotModel, system: ContactCellParameters, log: Log, depth: NDArray[np.float32]) -> list[Metric]:
    """Time the cycle on the run's own states and one of its frames."""
    states = np.hstack([log["position"], log["velocity"]])[:440]
    background = learn_background(robot, system, 1)
    seconds, _ = time_cycles(robot, system.camera, system.pipeline, states, depth, background)
    return [
        Metric("cycle_ms_median", 1e3 * float(np.median(seconds)), "ms", high=2.0, reported="5 ms cycle"),
        Metric("cycle_ms_p95", 1e3 * float(np.percentile(seconds, 95)), "ms", high=3.0, reported="5 ms cycle"),
    ]


def replay_contact(
    cell: Cell,
    log: Log,
    path: Path,
    title: str,
    more: Sequence[Arrow | Marker] = (),
    camera: tuple[tuple[float, float, float], tuple[float, float, float]] = ((-0.85, 1.2, 0.95), (0.0, 0.4, 0.55)),
) -> None:
    """Write the run as a page that plays offline: arm, hand, estimated contact, estimated and true force."""
    answered = np.isin(log["mode"][:, 0], (InteractionMode.CONTACT, InteractionMode.RETURN))
    truth, scale = log["contact_truth"], ARROW_SCALE
    touched = np.linalg.norm(truth[:, :3], axis=1) > 0.0
    # Arrows end at the contact, as a push does.
    tail = log["contact_position"] - scale * log["contact_force"]
    overlays = [
        Marker("estimated contact", log["contact_position"], 0.012, BLUE, answered),
        Arrow("estimated force", tail, log["contact_force"], scale, BLUE, answered),
        Arrow("true force", truth[:, 3:6] - scale * truth[:, :3], truth[:, :3], scale, GREEN, touched, 0.004),
        *more,
    ]
    write_replay(path, cell.copy_to, log.time, log["plant_position"], overlays, camera=camera, title=title)
