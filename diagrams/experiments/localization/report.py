"""Metrics, figure and replay of the contact localization."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from experiments.localization.judge import Shown
from experiments.localization.parameters import KINDS
from experiments.localization.scenario import BANDS, CASES, NEVER, TWO, ContactLocalizationScenario
from experiments.localization.scenes import ContactScenes
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.view.figures import BOUND, CYCLE, blank, legend
from saphari_drake.simulation.view.replay import Arrow, Marker, write_replay


def metrics(scenario: ContactLocalizationScenario, robot: RobotModel, log: Log, drawn: int) -> list[Metric]:
    """Return the metrics of the contract, those by link and by what touches, and the baselines'."""
    column = {name: log[name][:, 0] for name in log}
    error, case = column["error"], scenario.case
    high = {"one_camera": 0.006, "miscalibrated": 0.010, "hidden": 0.015}.get(case, np.inf)
    tail = {"one_camera": 0.020, "miscalibrated": 0.040, "hidden": 0.150}.get(case, np.inf)
    both = case in TWO
    high = 0.025 if both else high
    result = [
        Metric("median_m", float(np.median(error)), "m", high=high),
        Metric("p95_m", float(np.percentile(error, 95)), "m", high=tail),
        Metric("within_20mm", float(np.mean(error < 0.02)), "1", low=0.90 if case == "two_cameras" else -np.inf),
        Metric("link_correct", column["link_right"].mean(), "1", low=0.97 if case == "one_camera" else -np.inf),
        *_forces(robot, column, both),
        Metric("first_frame_median_m", np.median(column["first_error"]), "m"),
        Metric("first_frame_p95_m", np.percentile(column["first_error"], 95), "m"),
    ]
    for link in range(1, robot.n):
        rows = column["link"] == link
        name = robot.link_names[link]
        if rows.any():
            result += [
                Metric(f"{name}_median_m", np.median(error[rows]), "m"),
                Metric(f"{name}_p95_m", np.percentile(error[rows], 95), "m"),
                Metric(f"{name}_within_20mm", float(np.mean(error[rows] < 0.02)), "1"),
                Metric(f"{name}_link_correct", column["link_right"][rows].mean(), "1"),
                Metric(f"{name}_force_error_relative_median", np.median(column["force_error"][rows]), "1"),
            ]
    for k, kind in enumerate(KINDS):
        rows = column["kind"] == k
        if rows.any():
            result.append(Metric(f"{kind}_median_m", float(np.median(error[rows])), "m"))
            aims = case == "measured_people" and kind == "finger"
            high, share = (0.012, 0.01) if aims else (np.inf, np.inf)
            result.append(Metric(f"{kind}_p95_m", np.percentile(error[rows], 95), "m", high=high, decides=not aims))
            if kind in ("finger", "pinch"):
                limb = float(column["as_limb"][rows].mean())
                result.append(Metric(f"{kind}_taken_for_a_limb", limb, "1", high=share, decides=not aims))
            result.append(Metric(f"{kind}_radius_least_m", column["size"][rows].min(), "m"))
            result.append(Metric(f"{kind}_radius_most_m", column["size"][rows].max(), "m"))
    for name in ("baseline", "particle"):  # the published vision method, and the contact particle filter
        plain = column[f"{name}_error"]
        result += [
            Metric(f"{name}_median_m", float(np.median(plain)), "m"),
            Metric(f"{name}_p95_m", np.percentile(plain, 95), "m"),
            Metric(f"{name}_within_20mm", float(np.mean(plain < 0.02)), "1"),
            Metric(f"{name}_link_correct", column[f"{name}_link_right"].mean(), "1"),
            Metric(f"{name}_force_error_relative_median", np.median(column[f"{name}_force_error"]), "1"),
        ]
    if scenario.checked:
        for name in ("camera_error", "camera_error_before"):
            result.append(Metric(f"{name}_median_m", float(np.median(column[name])), "m"))
            result.append(Metric(f"{name}_p95_m", np.percentile(column[name], 95), "m"))
    return [
        *result,
        Metric("ambiguous_share", float(np.mean(column["other_weight"] > 0.1)), "1"),
        Metric("scenes", len(error) / (2 if both else 1), "1", low=min(200, scenario.count)),
        Metric("scenes_drawn", drawn, "1"),
    ]


def _forces(robot: RobotModel, column: dict, both: bool) -> list[Metric]:
    """Return the force's error; of two contacts, in scenes where both were found, and by pair of links."""
    if not both:
        return [Metric("force_error_relative_median", float(np.median(column["force_error"])), "1")]
    found = column["error"] < NEVER
    error = column["force_error"]
    result = [
        Metric("both_found", float(found.mean()), "1"),
        Metric("median_of_found_m", float(np.median(column["error"][found])), "m"),
        Metric("force_error_relative_median", float(np.median(error[found])), "1", high=0.20, decides=False),
    ]
    for low, high in pairwise(BANDS):
        rows = found & (column["force"] >= low) & (column["force"] < high)
        if rows.any():
            name = f"force_{low:.0f}_to_{high:.0f}_N"
            result.append(Metric(f"{name}_error_relative_median", float(np.median(error[rows])), "1"))
    for link in range(1, robot.n):
        for other in range(1, link):
            rows = found & (column["link"] == link) & (column["other_link"] == other)
            back = found & (column["link"] == other) & (column["other_link"] == link)
            if rows.any():
                name = f"{robot.link_names[link]}_and_{robot.link_names[other]}"
                result.append(Metric(f"{name}_force_error_relative_median", float(np.median(error[rows | back])), "1"))
    return result


def figure(scenario: ContactLocalizationScenario, log: Log):
    """Return histograms of the error, ours and the published method's, and the error by link."""
    result, axes = blank(2, 1, f"Contact localization, {CASES[scenario.case]}", (7.5, 6.0))
    bins = np.geomspace(0.5, 1000.0, 34)
    error, plain = 1e3 * log["error"][:, 0], 1e3 * log["baseline_error"][:, 0]
    top, bottom = axes[0, 0], axes[1, 0]
    top.hist(np.clip(plain, bins[0], bins[-1]), bins, color=CYCLE[1], alpha=0.5, label="published method")
    top.hist(np.clip(error, bins[0], bins[-1]), bins, color=CYCLE[0], alpha=0.7, label="this localizer")
    top.axvline(20.0, color=BOUND, linestyle="--", linewidth=0.9, label="20 mm")
    top.set_xscale("log")
    top.set_title("Error of the contact point (1000 mm: nothing found)", loc="left")
    top.set_xlabel("error [mm]")
    top.set_ylabel("scenes")
    legend(top)
    rng = np.random.default_rng(0)
    for k, kind in enumerate(KINDS):
        rows = log["kind"][:, 0] == k
        x = log["link"][rows, 0] + 1.0 + 0.22 * (k - 1) + rng.uniform(-0.07, 0.07, rows.sum())
        bottom.plot(x, np.clip(error[rows], 0.5, 1000.0), ".", color=CYCLE[k], markersize=4, label=kind)
    for link in np.unique(log["link"][:, 0]):
        median = np.median(error[log["link"][:, 0] == link])
        bottom.plot([link + 0.6, link + 1.4], [median, median], color="black", linewidth=1.2)
    bottom.set_yscale("log")
    bottom.set_title("Error by link and by what touches; bars: medians", loc="left")
    bottom.set_xlabel("link")
    bottom.set_ylabel("error [mm]")
    legend(bottom)
    return result


def replay(scenario: ContactLocalizationScenario, scenes: ContactScenes, shown: list[Shown], path: Path) -> None:
    """Write scenes one after the other: green the true point and force, blue what the localizer says."""
    times = np.array([2.0 * k + t for k in range(len(shown)) for t in (0.0, 1.999)])
    twice = {name: np.repeat([getattr(entry, name) for entry in shown], 2, axis=0) for name in Shown._fields}
    overlays: list[Arrow | Marker] = []
    for k in range(twice["true"].shape[1]):
        for name, point, force, color in (
            ("true", "true", "force", (0.1, 0.6, 0.2)),
            ("found", "found", "felt", (0.0, 0.45, 0.7)),
        ):
            overlays.append(Marker(f"{name}_{k}", twice[point][:, k], 0.02, color))
            tail = np.nan_to_num(twice[point][:, k]) - 0.006 * twice[force][:, k]
            overlays.append(Arrow(f"{name}_force_{k}", tail, twice[force][:, k], 0.006, color))
    title = f"{scenario.case}: true (green) and found (blue) contact and force"
    view = ((1.1, 0.8, 1.2), (0.0, 0.0, 0.6))
    write_replay(path, scenes.add_plant, times, twice["positions"], overlays, camera=view, title=title)
