"""Judgement of the mobile manipulator's cases."""

from __future__ import annotations

from copy import deepcopy

import numpy as np

from experiments.nmpc.mobile import SEEN, MobileParameters, controller_for
from experiments.nmpc.run import NmpcRun, counts, known_obstacles, margins, stoppable_clearance, timing
from saphari_drake.control.nmpc.kinematics import ramp_mean
from saphari_drake.control.nmpc.law import at_rest, nmpc_step
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.simulation.runner.results import Metric

REPORTED = {"1": "< 20 ms", "2": "slightly above case 1", "3": "< 80 ms"}


def judge_mobile(run: NmpcRun, params: MobileParameters, case: str) -> list[Metric]:
    """Return the metrics of a case; distances are those of the simulated robot at every step of 1 ms."""
    log = run.log
    error = log["position_error"][:, 0]
    least = log["clearance"].min()
    free = free_tracking_error(run, params) if case in ("2", "3") else -np.inf
    metrics = [
        Metric("min_clearance_m", least, "m", low=0.0 if case in ("3", "nonholonomic") else -np.inf),
        # With obstacles it cannot be less than without.
        Metric("tracking_error_mean_m", error.mean(), "m", low=free),
        Metric("tracking_error_max_m", error.max(), "m"),
        Metric("orientation_error_max_rad", log["orientation_error"].max(), "rad"),
    ]
    if case == "nonholonomic":
        metrics += [
            Metric("lateral_slip", np.abs(log["slip"]).max(), "m/s", high=1e-6),
            Metric("lateral_slip_commanded", np.abs(log["slip_commanded"]).max(), "m/s", high=1e-6),
        ]
    if case in ("human", *SEEN):
        metrics += [
            Metric("min_clearance_stoppable_m", stoppable_clearance(run, params.reaction), "m", low=0.0),
            Metric("path_end_error_m", error[-1], "m"),
            *_known(run),
            Metric("obstacles_held_share", float(np.mean(run.steps["obstacle_status"] == ObstacleStatus.HELD)), "1"),
            Metric("obstacles_lost_share", float(np.mean(run.steps["obstacle_status"] == ObstacleStatus.LOST)), "1"),
        ]
    return [*metrics, *counts(run), *timing(run, REPORTED.get(case, "")), *margins(run)]


def free_tracking_error(run: NmpcRun, params: MobileParameters) -> float:
    """Return the mean position error (m) of case 1, the same job without obstacles, on an ideal velocity interface."""
    job, period = run.cell.job, params.cell.controller.period
    controller = controller_for("1", deepcopy(params.cell.controller))
    problem = NmpcProblem(job.robot, job.end_effector, job.points, controller)
    q, errors = job.robot.home, []
    memory = at_rest(problem, q)
    for k in range(len(run.steps.time) - 1):
        time = k * period
        reference = job.horizon_reference(time, period, controller.horizon)
        memory = nmpc_step(problem, memory, q, reference, ObstaclePoints(), 0.0)
        ramp = controller.ramp * period
        ways = [t * ramp_mean(memory.before, memory.command, ramp, t) for t in (0.0, 0.5 * period, period)]
        for share, way in zip((0.0, 0.5), ways):
            tip = problem.end_effector_pose(q + way)[1]
            errors.append(np.linalg.norm(tip - job.reference(time + share * period)[1]))
        q = q + ways[-1]
    return float(np.mean(errors))


def _known(run: NmpcRun) -> list[Metric]:
    """Return how far the points that the controller knew lie from the person's surface, and how much they leave out."""
    errors, uncovered = [], []
    for time, rows in zip(run.steps.time, known_obstacles(run)):
        rows = rows[np.isfinite(rows[:, 3])]
        truth = run.cell.job.obstacles(float(time))
        if len(rows) == 0:
            continue
        away = np.linalg.norm(rows[:, None, :3] - truth.p_WO[None], axis=2)
        errors.append((away - truth.radius[None]).min(axis=1).clip(0.0).max())
        covered = away.T - rows[None, :, 3] - truth.radius[:, None]
        uncovered.append(float(np.mean(covered.min(axis=1) > 0.0)))
    if not errors:
        return [Metric("known_error_p95_m", 0.0, "m"), Metric("unknown_share", 1.0, "1")]
    return [
        Metric("known_error_p95_m", float(np.percentile(errors, 95)), "m"),
        Metric("unknown_share", float(np.mean(uncovered)), "1"),
    ]
