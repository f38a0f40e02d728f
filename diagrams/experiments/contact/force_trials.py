"""Random touches of the arm that keeps a force: posture, link, point, direction, and how far the person leans in."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from experiments.contact.force_judge import REST, steady_norms, true_velocity
from experiments.contact.judge import deflection, find_touches
from experiments.contact.random_run import Build, seen_by, trial_of
from experiments.contact.run import ContactSetup
from experiments.trials import Panel, Shown, Trial, share_metrics
from saphari_drake.errors import SensorError
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation

FORCE, WANDER = 0.5, 0.05  # N, m: what a touch has to meet
PANELS = (
    Panel("force_norm_error_N", 1.0, "error of the force's size [N]", FORCE),
    Panel("max_speed", 1.0, "fastest contact point [m/s]", np.inf),
    Panel("joint_speed_share_max", 1e2, "largest joint speed [% of its limit]", 1.0),
    Panel("wander_m", 1e3, "way after the release [mm]", WANDER),
)


def force_trial(scenario: Any, number: int) -> Any:
    """Return the scenario that runs one touch alone: the hand of `scenario.hand`, leaning in as far as is drawn."""
    single, hand = trial_of(scenario, number).scenario, scenario.hand
    depth = float(np.random.default_rng([scenario.seed, number, 2]).uniform(*scenario.depths))
    push = single.pushes[0]
    single.pushes = [replace(hand, link=push.link, aim=push.aim, direction=push.direction, start=push.start,
                             hold=push.hold, depth=depth)]  # fmt: skip
    return single


def run_force_trial(
    scenario: Any,
    number: int,
    build: Build,
    figure: Callable[[ContactSetup, Log], Figure],
    replay: Callable[[ContactSetup, Log, Path], None],
    options: RunOptions,
    label: str,
) -> Trial:
    """Run one touch and judge it."""
    single = force_trial(scenario, number)
    setup = build(single, options.meshcat)
    run, push = Simulation(setup.diagram, label, options), single.pushes[0]
    seen = seen_by(run, setup, push.start + push.hold - 0.1)
    run.to(setup.duration)
    log, fast = run.log(setup.recorder), run.log(setup.fast)
    values = {**judged_touch(setup, log, fast), "seen": float(seen)}
    limit = single.system.pipeline.controller.speed_limit
    met = (
        values["force_norm_error_N"] <= FORCE
        and values["wander_m"] <= WANDER
        and values["max_speed"] <= limit
        and values["joint_speed_share_max"] <= 1.0
    )
    about = (
        f"{push.link}, {'seen' if seen else 'hidden'}, {1e3 * push.depth:.0f} mm deep, force off by "
        f"{values['force_norm_error_N']:.1f} N, wander {1e3 * values['wander_m']:.0f} mm, "
        f"speed {values['joint_speed_share_max']:.1f}"
    )
    shown = Shown(log, lambda: figure(setup, log), lambda path: replay(setup, log, path))
    return Trial(number, values, met, about, shown)


def judged_touch(setup: ContactSetup, log: Log, fast: Log) -> dict[str, float]:
    """Return what one touch comes to; of a touch that never was, the whole force is missing."""
    robot, desired = setup.robot, setup.scenario.system.pipeline.controller.desired_force
    speed, excess = limit_metrics(robot, fast["velocity"], fast["torque_excess"])
    values = {
        "force_norm_error_N": desired,
        "wander_m": 1.0,
        "max_speed": float(np.linalg.norm(true_velocity(log, robot), axis=1).max()),
        speed.name: speed.value,
        excess.name: excess.value,
    }
    try:
        (touch,) = find_touches(log, robot, setup.pushes)
    except SensorError:
        return values
    shown, _, _ = steady_norms(log, touch)
    rows = np.flatnonzero(log.time >= log.time[touch.release] + REST)
    way = deflection(log, robot, touch, rows)
    values["force_norm_error_N"] = abs(shown - desired)
    values["wander_m"] = float(np.linalg.norm(way - way[0], axis=1).max())
    return values


def force_trial_metrics(columns: Mapping[str, NDArray[np.float64]], speed_limit: float) -> list[Metric]:
    """Return the metrics of the contract; none decides."""

    def most(name: str, value: float, unit: str, high: float) -> Metric:
        return Metric(name, value, unit, high=high, decides=False)

    seen = columns["seen"] > 0.0
    return [
        *share_metrics("meets_all_share", columns["met"], 0.95),
        *(share_metrics("meets_all_share_seen", columns["met"][seen], 0.95) if seen.any() else []),
        Metric("trials_seen", seen.sum(), "1"),
        most("force_norm_error_p95_N", np.percentile(columns["force_norm_error_N"], 95), "N", FORCE),
        Metric("force_norm_error_median_N", np.median(columns["force_norm_error_N"]), "N"),
        most("max_speed", columns["max_speed"].max(), "m/s", speed_limit),
        most("joint_speed_share_max", columns["joint_speed_share_max"].max(), "1", 1.0),
        most("torque_excess_max", columns["torque_excess_max"].max(), "Nm", 0.0),
        most("wander_max_m", columns["wander_m"].max(), "m", WANDER),
    ]
