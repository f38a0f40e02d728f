"""Runs of the safe cell: every trial in every way, and the metrics of all."""

from __future__ import annotations

import numpy as np

from experiments.cell.build import build_cell
from experiments.cell.judge import CellRun, hits_of
from experiments.cell.scenario import CellScenario
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation


def simulate(scenario: CellScenario, trial: int, way: str, options: RunOptions | None = None) -> CellRun:
    """Run one trial in one way, until its job is done or its time is over."""
    options = options or RunOptions()
    rig = build_cell(scenario, trial, way, options.meshcat)
    run = Simulation(rig.diagram, f"{scenario.case}, trial {trial}, {way}", options)
    progress = rig.pipeline.job.GetOutputPort("progress")
    end = 0.0
    while end < scenario.duration:
        end = min(end + 0.5, scenario.duration)
        context = run.to(end)
        if progress.Eval(rig.pipeline.job.GetMyContextFromRoot(context))[0] >= scenario.job_time:
            break
    fast = run.log(rig.fast)
    return CellRun(rig, way, trial, fast, run.log(rig.slow), run.wall, hits_of(rig, fast))


def metrics_of(runs: list[CellRun], scenario: CellScenario) -> list[Metric]:
    """Return the metrics of the contract, over all trials."""
    by_way = {way: [run for run in runs if run.way == way] for way in scenario.ways}
    own = by_way.get("supervised") or runs
    times = {way: float(np.mean([run.job_time_at_least for run in some])) for way, some in by_way.items() if some}
    hits = [hit for run in own for hit in run.hits]
    metrics = [
        Metric("limit_violations", float(sum(run.violations for run in own)), "1", high=0.0),
        Metric("energy_share_max", max(run.energy_share for run in own), "1", high=1.0),
        Metric("force_share_max", max(run.force_share for run in own), "1"),
        Metric("torque_step_share_max", max(run.torque_step for run in own), "1"),
        Metric("contacts", float(len(hits)), "1"),
        Metric("stops", float(sum(run.stops for run in own)), "1"),
        Metric("jobs_done", float(sum(np.isfinite(run.job_time) for run in own)), "1"),
        Metric("trials", float(len(own)), "1"),
    ]
    names = {
        "supervised": ("job_time_s", "jobs_per_hour"),
        "separation": ("job_time_ssm_only_s", "jobs_per_hour_ssm_only"),
        "stop_at_contact": ("job_time_stop_at_contact_s", "jobs_per_hour_stop_at_contact"),
        "force_limited": ("job_time_force_limited_s", "jobs_per_hour_force_limited"),
    }
    for way, time in times.items():
        metrics += [Metric(names[way][0], time, "s"), Metric(names[way][1], 3600.0 / time, "1/h")]
        if way != "supervised":
            shares = [run.energy_share for run in by_way[way]]
            metrics.append(Metric(f"energy_share_max_{way}", max(shares), "1"))
    if {"supervised", "separation"} <= set(times):
        saved = 1.0 - times["supervised"] / times["separation"]
        metrics.append(Metric("job_time_saved_over_ssm", saved, "1", low=0.15, decides=False))
    if {"supervised", "stop_at_contact"} <= set(times):
        more = times["stop_at_contact"] / times["supervised"] - 1.0
        metrics.append(Metric("throughput_over_stop_at_contact", more, "1", low=0.45, decides=False))
    velocity = np.vstack([run.fast["velocity"] for run in own])
    factor = float(np.mean([run.fast.time[-1] / run.wall for run in own]))
    return [
        *metrics, *limit_metrics(own[0].rig.robot, velocity, None),
        Metric("real_time_factor", factor, "1", decides=False),
    ]  # fmt: skip
