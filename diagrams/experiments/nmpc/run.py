"""Runs of the predictive control: simulate, add what follows from the positions, judge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RotationMatrix

from experiments.nmpc.build import KNOWN, NmpcCell
from experiments.nmpc.jobs import clearance, frame_pose, point_positions
from saphari_drake.control.nmpc.parameters import NmpcStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.simulation.world.wheels import lateral_slip

Array = NDArray[np.float64]

# Statuses in which the controller brakes instead of following its plan.
FALLBACKS = (
    NmpcStatus.BRAKING,
    NmpcStatus.START_INSIDE,
    NmpcStatus.BAD_INPUT,
    NmpcStatus.OBSTACLES_LOST,
    NmpcStatus.UNSOLVED,
)
STOPPED = 1.0e-3  # rad/s or m/s; no joint is faster when the robot stands


@dataclass(frozen=True)
class NmpcRun:
    """What was recorded.

    Attributes
    ----------
    cell : NmpcCell
    log : Log
        At every step of the plant.
    steps : Log
        At the end of every control period: what was decided at its start. The first row repeats in the second.
    real_time_factor : float
    """

    cell: NmpcCell
    log: Log
    steps: Log
    real_time_factor: float


def simulate(cell: NmpcCell, duration: float, label: str, options: RunOptions | None = None) -> NmpcRun:
    """Simulate a cell for `duration` (s) and add to the log what follows from the plant's true positions."""
    cell.controller.seconds.clear()
    run = Simulation(cell.diagram, label, options)
    run.to(duration)
    log, steps = run.log(cell.recorder), run.log(cell.slow_recorder)
    add_signals(cell, log)
    seconds = cell.controller.seconds
    steps.add("step_time", np.array([seconds[0], *seconds])[: len(steps.time)], "s")
    held = np.searchsorted(steps.time, log.time + 1e-9, side="right") - 1
    for name in ("status", "step_time", "slack"):
        log.add(name, steps[name][held], steps.units[name])
    return NmpcRun(cell, log, steps, run.real_time_factor)


def add_signals(cell: NmpcCell, log: Log) -> None:
    """Add clearance, end effector, its reference and errors, and the platform's slip, at every sample."""
    job = cell.job
    zero, count = np.zeros(job.robot.n), len(log.time)
    gaps, distances = np.empty(count), np.empty(count)
    tips, goals, turns = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
    for k, (time, q) in enumerate(zip(log.time, log["position"])):
        terms = evaluate_dynamics(job.robot, q, zero)
        points, obstacles = point_positions(job.robot, job.points, terms), job.obstacles(time)
        gaps[k] = clearance(points, job.points, obstacles)
        distances[k] = _distance(points, obstacles.p_WO)
        R, tips[k] = frame_pose(job.robot, job.end_effector, terms)
        R_goal, goals[k] = job.reference(time)
        turns[k] = RotationMatrix(R_goal.T @ R).ToAngleAxis().angle()
    log.add("clearance", gaps, "m")
    log.add("distance", distances, "m")
    log.add("tip", tips, "m")
    log.add("reference", goals, "m")
    log.add("position_error", np.linalg.norm(tips - goals, axis=1), "m")
    log.add("orientation_error", turns, "rad")
    base = cell.params.controller.nonholonomic
    if base:
        joints = [job.robot.joint_index(name) for name in base]
        heading = log["position"][:, joints[2]]
        log.add("slip", lateral_slip(heading, log["velocity"], joints), "m/s")
        log.add("slip_commanded", lateral_slip(heading, log["velocity_commanded"], joints), "m/s")


def _distance(points: Array, p_WO: Array) -> float:
    if len(p_WO) == 0:
        return np.inf
    return float(np.min(np.linalg.norm(points[:, None] - np.asarray(p_WO)[None], axis=2)))


def timing(run: NmpcRun, reported: str) -> list[Metric]:
    """Return the controller's computing time; `reported` is what the deliverable states."""
    seconds = 1e3 * run.steps["step_time"][1:, 0]  # of the first step there are two rows
    return [
        Metric("step_ms_median", float(np.median(seconds)), "ms", reported=reported),
        Metric("step_ms_p95", float(np.percentile(seconds, 95)), "ms", reported=reported),
        Metric("step_ms_max", float(seconds.max()), "ms", reported=reported),
    ]


def counts(run: NmpcRun) -> list[Metric]:
    """Return how often the controller had to fall back, use its slack, or stop, of how many steps."""
    decided = run.steps["status"][1:, 0]
    return [
        Metric("steps", decided.size, "1"),
        Metric("fallbacks", float(np.sum(np.isin(decided, FALLBACKS))), "1"),
        Metric("slack_steps", float(np.sum(decided == NmpcStatus.SLACK)), "1"),
        Metric("stops", stops(run), "1"),
    ]


def stops(run: NmpcRun) -> int:
    """Count how often the commanded motion came to rest after it had begun, before the end."""
    speed = np.abs(run.log["velocity_commanded"]).max(axis=1)
    moving = speed > STOPPED
    if not moving.any():
        return 0
    first, last = int(np.argmax(moving)), int(len(moving) - 1 - np.argmax(moving[::-1]))
    return int(np.sum(np.diff(moving[first : last + 1].astype(int)) == -1))


def stoppable_clearance(run: NmpcRun, reaction: float) -> float:
    """Return the least clearance (m) over the samples at which stopping could have kept it at 0 or more.

    Stopping could have kept it at time t if the robot, where it was a `reaction` (s) before (one control period to
    notice, and the time to brake), is clear of the obstacles as they are at t. Where a person reaches into a robot that
    stands, no stop helps: those samples do not count.
    """
    job, log = run.cell.job, run.log
    gaps = log["clearance"][:, 0]
    before = np.searchsorted(log.time, log.time - reaction - 1e-9).clip(0)
    for k in np.argsort(gaps):
        terms = evaluate_dynamics(job.robot, log["position"][before[k]], np.zeros(job.robot.n))
        points = point_positions(job.robot, job.points, terms)
        if clearance(points, job.points, job.obstacles(log.time[k])) >= 0.0:
            return float(gaps[k])
    return np.inf


def margins(run: NmpcRun) -> list[Metric]:
    """Return how far the run stayed from the robot's own limits, and how well the servo followed."""
    robot, log = run.cell.job.robot, run.log
    limited = np.isfinite(robot.q_min) & np.isfinite(robot.q_max)
    q = log["position"][:, limited]
    room = min((robot.q_max[limited] - q).min(), (q - robot.q_min[limited]).min())
    lag = np.abs(log["velocity"] - log["velocity_commanded"]) / robot.v_max
    return [
        Metric("limit_margin_rad", room, "rad", low=0.0),
        Metric("max_speed_share", np.abs(log["velocity_commanded"] / robot.v_max).max(), "1", high=1.0 + 1e-9),
        Metric("servo_error_p95_share", float(np.percentile(lag.max(axis=1), 95)), "1"),
        *limit_metrics(robot, log["velocity"], log["torque_excess"]),
        Metric("real_time_factor", run.real_time_factor, "1", decides=False),
    ]


def known_obstacles(run: NmpcRun) -> Array:
    """Return the obstacle points that the controller knew, (T, KNOWN, 4): position and radius (m), NaN where none."""
    return run.steps["obstacles_known"].reshape(len(run.steps.time), KNOWN, 4)
