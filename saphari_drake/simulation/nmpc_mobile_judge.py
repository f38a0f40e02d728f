"""Judgement of the mobile manipulator's cases."""

from __future__ import annotations

import numpy as np

from saphari_drake.simulation.experiment import Metric
from saphari_drake.simulation.nmpc_mobile import MobileParameters
from saphari_drake.simulation.nmpc_run import NmpcRun, counts, margins, stoppable_clearance, timing

REPORTED = {"1": "< 20 ms", "2": "slightly above case 1", "3": "< 80 ms"}


def judge_mobile(run: NmpcRun, params: MobileParameters, case: str) -> list[Metric]:
    """Return the metrics of a case; distances are those of the simulated robot at every step of 1 ms."""
    log = run.log
    error = log["position_error"][:, 0]
    least = log["clearance"].min()
    metrics = [
        Metric("min_clearance_m", least, "m", low=0.0 if case in ("3", "nonholonomic") else -np.inf),
        Metric("tracking_error_mean_m", error.mean(), "m"),
        Metric("tracking_error_max_m", error.max(), "m"),
        Metric("orientation_error_max_rad", log["orientation_error"].max(), "rad"),
    ]
    if case == "nonholonomic":
        metrics += [
            Metric("lateral_slip", np.abs(log["slip"]).max(), "m/s", high=1e-6),
            Metric("lateral_slip_commanded", np.abs(log["slip_commanded"]).max(), "m/s", high=1e-6),
        ]
    if case in ("human", "human_seen"):
        metrics += [
            Metric("min_clearance_stoppable_m", stoppable_clearance(run, params.reaction), "m", low=0.0),
            Metric("path_end_error_m", error[-1], "m"),
            Metric("obstacles_held_share", float(np.mean(run.steps["obstacle_status"] == 1)), "1"),
            Metric("obstacles_lost_share", float(np.mean(run.steps["obstacle_status"] == 2)), "1"),
        ]
    return [*metrics, *counts(run), *timing(run, REPORTED.get(case, "")), *margins(run)]
