"""What every experiment in the contact cell does alike: load, aim, record, run, time and replay."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from experiments.contact.cell import ContactCell, ContactCellParameters, learn_background
from experiments.contact.cycle_time import time_cycles
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.people.pushing_hand import Push
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.experiment import Log, Metric, RunOptions, advance
from saphari_drake.simulation.view.replay import Arrow, Marker, write_replay
from saphari_drake.simulation.world.cell import add_cell, contact_truth

Array = NDArray[np.float64]
BLUE, GREEN = (0.0, 0.25, 0.80), (0.0, 0.62, 0.45)
ARROW_SCALE = 0.008  # m/N


@dataclass
class ContactScenario:
    """Everything that a run of the contact cell depends on."""

    case: str
    # Seed of the camera's noise and of where the person aims.
    seed: int = 0
    # s
    duration: float = 18.0
    # Catalog name, or path of a URDF or SDF.
    robot: str = "lwr4"
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


def record_contact(builder: DiagramBuilder, parts: ContactCell, period: float) -> Recorder:
    """Record, once a cycle, what the figures and the judgement of every controller need."""
    recorder, cell, p = Recorder(builder, period), parts.cell, parts.pipeline
    n, num_positions = cell.robot.n, cell.plant.num_positions()
    recorder.add("plant_position", cell.plant.get_state_output_port(), "mixed", lambda x: x[:num_positions])
    recorder.add("position", cell.robot_state, "rad", lambda x: x[:n])
    recorder.add("velocity", cell.robot_state, "rad/s", lambda x: x[n:])
    recorder.add("residual", p.observer.GetOutputPort("residual"), "Nm")
    recorder.add("contact", p.detector.GetOutputPort("contact"), "1")
    recorder.add("mode", p.monitor.GetOutputPort("mode"), "InteractionMode")
    recorder.add("active_link", p.monitor.GetOutputPort("active_contact"), "index", lambda c: [c.link])
    recorder.add("camera_status", p.localizer.GetOutputPort("camera_status"), "CameraStatus")
    recorder.add("contact_force", p.force.GetOutputPort("contact_force"), "N")
    recorder.add("force_rank", p.force.GetOutputPort("rank"), "1")
    recorder.add("contact_position", p.controller.GetOutputPort("contact_position"), "m")
    recorder.add("torque", p.torque_output, "Nm")
    recorder.add("torque_excess", p.controller.GetOutputPort("torque_excess"), "Nm")
    truth = cell.plant.get_contact_results_output_port()
    recorder.add("contact_truth", truth, "N, m, index", lambda results: contact_truth(results, cell), 7)
    return recorder


def record_velocity(builder: DiagramBuilder, parts: ContactCell) -> Recorder:
    """Record the joint velocities at every millisecond, for `limit_metrics`."""
    recorder, n = Recorder(builder, 0.001), parts.cell.robot.n
    recorder.add("velocity_1ms", parts.cell.robot_state, "rad/s", lambda x: x[n:])
    return recorder


def simulate(
    diagram: Diagram, parts: ContactCell, pushes: Sequence[Push], duration: float, label: str, options: RunOptions
) -> tuple[Simulator, NDArray[np.float32], float]:
    """Run a diagram; return its simulator, the depth image (m) of the first push, and the wall time (s)."""
    simulator = Simulator(diagram)
    simulator.set_target_realtime_rate(options.realtime_rate)
    simulator.Initialize()
    first = pushes[0]
    middle = min(first.start + min(first.hold, 2.5), duration)
    wall = advance(simulator, middle, label)
    image = parts.sampler.GetOutputPort("depth_image").Eval(parts.sampler.GetMyContextFromRoot(simulator.get_context()))
    depth = image.data[..., 0].copy()
    wall += advance(simulator, duration - middle, label)
    return simulator, depth, wall


def timing(
    robot: RobotModel,
    system: ContactCellParameters,
    log: Log,
    depth: NDArray[np.float32],
    duration: float,
    wall: float,
) -> list[Metric]:
    """Time the cycle on the run's own states and one of its frames, and tell how fast the run was."""
    states = np.hstack([log["position"], log["velocity"]])[:440]
    background = learn_background(robot, system, 1)
    seconds, _ = time_cycles(robot, system.camera, system.pipeline, states, depth, background)
    return [
        Metric("cycle_ms_median", 1e3 * float(np.median(seconds)), "ms", high=2.0, reported="5 ms cycle"),
        Metric("cycle_ms_p95", 1e3 * float(np.percentile(seconds, 95)), "ms", high=3.0, reported="5 ms cycle"),
        Metric("real_time_factor", duration / wall, "1", 0.25, decides=False),
    ]


def replay_contact(
    robot: RobotModel,
    system: ContactCellParameters,
    log: Log,
    path: Path,
    title: str,
    more: Sequence[Arrow | Marker] = (),
    camera: tuple[tuple[float, float, float], tuple[float, float, float]] = ((-0.85, 1.2, 0.95), (0.0, 0.4, 0.55)),
) -> None:
    """Write the run as a page that plays offline: arm, hand, estimated contact, estimated and true force."""

    def plant(builder: DiagramBuilder):
        return add_cell(builder, robot, system.cell).plant

    answered = (log["mode"][:, 0] == 1) | (log["mode"][:, 0] == 2)
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
    write_replay(path, plant, log.time, log["plant_position"], overlays, camera=camera, title=title)
