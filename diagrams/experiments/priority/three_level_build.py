"""The diagram of the three-level job: arm with torques, sensor, controller and servo; its judgement, and Drake's IK."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder

from experiments.priority.drake_ik import DifferentialIK, median_seconds
from experiments.priority.switches import find_switches
from experiments.priority.three_level import ThreeLevelJob, circle_reference, clearances
from saphari_drake.control.reverse_priority.law import PriorityStatus
from saphari_drake.control.reverse_priority.system import ReversePriorityController, position_reference
from saphari_drake.pipelines.envelope import JointState
from saphari_drake.pipelines.velocity import VelocityPipelineParameters, add_velocity_pipeline
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.faults.injection import inject_into
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.record.robot import record_robot
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.sensors.joint_sensor import JointSensor, JointSensorParameters
from saphari_drake.simulation.view.replay import show
from saphari_drake.simulation.world.cell import Cell, add_cell
from saphari_drake.simulation.world.profile import Truth
from saphari_drake.simulation.world.references import Reference

Array = NDArray[np.float64]


class ThreeLevelCell(NamedTuple):
    """A diagram and what is needed to run and judge it."""

    job: ThreeLevelJob
    cell: Cell
    controller: ReversePriorityController
    diagram: Diagram
    recorder: Recorder


def build_three_level(job: ThreeLevelJob, meshcat: Meshcat | None = None, truth: Truth | None = None) -> ThreeLevelCell:
    """Build the diagram: sensor → dynamics and controller → envelope → servo → torques, all at the same cycle."""
    robot, params, truth = job.robot, job.params, truth or Truth()
    period = params.controller.period
    builder = DiagramBuilder()
    cell = add_cell(builder, robot, truth=truth)
    exact = JointSensorParameters(period=period, differentiate=False)
    sensor = builder.AddNamedSystem("joint_sensor", JointSensor(robot, truth.joint_sensor(exact)))
    measured = JointState(sensor.GetOutputPort("position_measured"), sensor.GetOutputPort("velocity_measured"))
    velocity = add_velocity_pipeline(
        builder, robot, measured, VelocityPipelineParameters(params.envelope, servo=params.servo)
    )
    controller = builder.AddNamedSystem("controller", ReversePriorityController(robot, job.levels, params.controller))
    path = builder.AddNamedSystem("path", Reference({"value": lambda t: circle_reference(job, t)}, period))
    person = builder.AddNamedSystem("person", Reference({"value": job.person}, period))
    builder.Connect(cell.robot_state, sensor.GetInputPort("state"))
    builder.Connect(measured.position, controller.GetInputPort("position_measured"))
    builder.Connect(path.GetOutputPort("value"), controller.GetInputPort("references"))
    builder.Connect(person.GetOutputPort("value"), controller.GetInputPort("targets"))
    builder.Connect(controller.GetOutputPort("velocity_commanded"), velocity.command_input)
    builder.Connect(velocity.torque_output, cell.torque_input)
    recorder = record_robot(builder, cell, 0.001)
    recorder.add("position_measured", measured.position, "rad")
    recorder.add("person", person.GetOutputPort("value"), "m, m/s")
    recorder.add("reference", path.GetOutputPort("value"), "m, m/s", lambda r: np.append(r[9:12], r[15:18]))
    for name, unit in (
        ("velocity_commanded", "rad/s"),
        ("activation", "1"),
        ("task_error", "m"),
        ("smallest_singular_value", "m"),
        ("task_scale", "1"),
        ("status", "1"),
    ):
        recorder.add(name, controller.GetOutputPort(name), unit)
    inject_into(builder, cell, truth)
    recorder.add("torque", velocity.torque_output, "Nm")
    recorder.add("torque_excess", velocity.limit.GetOutputPort("torque_excess"), "Nm")
    show(builder, cell.scene_graph, meshcat)
    return ThreeLevelCell(job, cell, controller, builder.Build(), recorder)


def add_three_level_signals(cell: ThreeLevelCell, log: Log) -> None:
    """Add to a log what follows from the positions: clearance of every pair, end effector, elbow."""
    job = cell.job
    links = [job.robot.frame(name)[0] for name in (job.params.elbow_frame, job.params.tip)]
    persons = log["person"].reshape(-1, 2, 6)
    log.add("clearance", [clearances(job.robot, job.params, q, o) for q, o in zip(log["position"], persons)], "m")
    poses = [evaluate_dynamics(job.robot, q, np.zeros(job.robot.n)).p_WL for q in log["position"]]
    log.add("elbow", [p[links[0]] for p in poses], "m")
    log.add("tip", [p[links[1]] for p in poses], "m")
    log.add("clearance_min", log["clearance"].min(axis=1), "m")
    log.add("path_error", np.linalg.norm(log["tip"] - log["reference"][:, :3], axis=1), "m")
    log.add("speed_share", np.abs(log["velocity_commanded"] / job.robot.v_max).max(axis=1), "1")


def judge_three_level(cell: ThreeLevelCell, log: Log) -> list[Metric]:
    """Return the metrics; the hard constraints are judged at every sample of 1 ms, of the plant's true state."""
    job, q = cell.job, log["position"]
    margin = min((job.robot.q_max - q).min(), (q - job.robot.q_min).min())
    status, elbow = log["status"][:, 0], log["elbow"][:, 1]
    low, high = job.params.elbow
    outside = np.mean((elbow < low) | (elbow > high))
    references = np.array([[position_reference(r[:3], r[3:])] for r in log["reference"]])
    before = np.vstack([np.zeros((1, job.robot.n)), log["velocity_commanded"][:-1]])
    decay, period, targets = job.params.controller.decay, job.params.controller.period, log["person"].reshape(-1, 2, 6)
    args = log["position_measured"], decay * before, references, targets, log["activation"], period
    switches = find_switches(cell.controller.stack, *args)
    return [
        Metric("min_clearance_m", log["clearance_min"].min(), "m", low=job.params.clearance),
        Metric("min_limit_margin_rad", margin, "rad", low=0.0),
        Metric("max_speed_share", log["speed_share"].max(), "1", high=1.0 + 1e-9),
        Metric("path_error_median_m", float(np.median(log["path_error"])), "m"),
        Metric("path_error_max_m", log["path_error"].max(), "m"),
        Metric("elbow_outside_share", float(outside), "1"),
        Metric("velocity_step_max", np.abs(np.diff(log["velocity_commanded"], axis=0)).max(), "rad/s"),
        Metric("activation_jump_max", np.abs(np.diff(log["activation"], axis=0)).max(), "1", high=0.5),
        Metric("switch_velocity_step_max", max((s.step for s in switches), default=0.0), "rad/s"),
        Metric("switch_velocity_share_max", max((s.share for s in switches), default=0.0), "1", high=1.0),
        Metric("scaled_share", float(np.mean(status == PriorityStatus.SCALED)), "1"),
        Metric("unreachable_share", float(np.mean(status == PriorityStatus.LIMITED)), "1"),
        *limit_metrics(job.robot, log["velocity"], log["torque_excess"]),
    ]


def drake_three_level(cell: ThreeLevelCell, log: Log) -> list[Metric]:
    """Run the same job, kinematically, through Drake's differential IK, with the person's motion told to it as well."""
    job, stack = cell.job, cell.controller.stack
    robot, params = job.robot, job.params
    period, gain = params.controller.period, params.gain
    rows = np.array([i for i, (bound, _) in enumerate(stack.sides) if " to target" in bound.component.name])
    ik = DifferentialIK(robot, period, stack.bounds[rows])
    link = robot.frame(params.tip)[0]
    q, v = robot.home.copy(), np.zeros(robot.n)
    persons, references = log["person"].reshape(-1, 2, 6), log["reference"]
    count, unsolved = len(log.time), 0
    gaps, errors, velocities = np.empty(count), np.empty(count), np.empty((count, robot.n))
    for k in range(count):
        x, J, own = stack.constraints(q, persons[k])
        point = evaluate_dynamics(robot, q, v).point(link, np.zeros(3))
        missing = references[k, :3] - point.p_WC
        gaps[k], errors[k] = -x[rows].max(), np.linalg.norm(missing)
        step = ik.step(q, v, point.Jv_WC, references[k, 3:] + gain * missing, x[rows] + period * own[rows], J[rows])
        unsolved += not step.solved
        v = step.v
        velocities[k] = v
        q = q + period * v
    reference = circle_reference(job, 1.0)[None]
    own_time = median_seconds(lambda: stack.solve(q, v, reference, persons[-1], period))
    arguments = q, v, point.Jv_WC, references[-1, 3:] + gain * missing, x[rows] + period * own[rows], J[rows]
    return [
        Metric("drake_min_clearance_m", gaps.min(), "m"),
        Metric("drake_path_error_median_m", float(np.median(errors)), "m"),
        Metric("drake_path_error_max_m", errors.max(), "m"),
        Metric("drake_velocity_step_max", np.abs(np.diff(velocities, axis=0)).max(), "rad/s"),
        Metric("drake_unsolved_steps", unsolved, "1"),
        Metric("step_ms_median", 1e3 * own_time, "ms", high=0.1),
        Metric("drake_step_ms_median", 1e3 * median_seconds(lambda: ik.step(*arguments)), "ms"),
    ]
