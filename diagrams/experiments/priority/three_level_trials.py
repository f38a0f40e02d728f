"""Random jobs of three levels on an arm: posture, circle, and the motion of the person."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.priority.figures import three_level_figure, three_level_replay
from experiments.priority.three_level import ThreeLevelJob, ThreeLevelParameters, three_level_job, with_faults
from experiments.priority.three_level_build import ThreeLevelCell, add_three_level_signals, build_three_level
from experiments.trials import Panel, Shown, Trial, drawn_posture, share_metrics
from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_positive
from saphari_drake.robots import catalog
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation

Array = NDArray[np.float64]
PANELS = (
    Panel("hard_violation", 1.0, "hard constraints violated", 0.0),
    Panel("clearance_margin_m", 1e3, "least clearance beyond the asked one [mm]", 0.0),
    Panel("path_error_median_m", 1e3, "median error of the path [mm]", np.inf),
    Panel("speed_share_max", 1e2, "largest command [% of its limit]", 1.0),
)


@dataclass
class RandomPersonParameters:
    """How random jobs are drawn. Ranges are [low, high], uniform."""

    # deg; each joint starts up to so far from home.
    posture: float = 20.0
    # m and s, circle of the end effector; m/s, speed limit of the person.
    circle: list[float] = field(default_factory=lambda: [0.05, 0.15])
    turn: list[float] = field(default_factory=lambda: [4.0, 8.0])
    person_speed: list[float] = field(default_factory=lambda: [0.1, 0.25])
    # m; by which the centres of the person's hand and elbow differ from those of the case.
    centre: float = 0.1

    def __post_init__(self) -> None:
        require_positive(self, "posture", "circle", "turn", "person_speed", "centre")
        for name in ("circle", "turn", "person_speed"):
            value = getattr(self, name)
            if len(value) != 2 or value[0] > value[1]:
                raise ParameterError(name, f"needs [low, high], got {value}")


def draw_person(scenario: Any, number: int) -> ThreeLevelJob:
    """Return one job of a `ReversePriorityScenario`; it is the same on every machine."""
    drawn, rng = scenario.random, np.random.default_rng([scenario.seed, number])
    robot = scenario.known(catalog.load("lwr4"))
    params: ThreeLevelParameters = deepcopy(scenario.arm)
    params.circle, params.turn = rng.uniform(*drawn.circle), rng.uniform(*drawn.turn)
    params.person_speed = rng.uniform(*drawn.person_speed)
    params.hand_centre = (params.hand_centre + drawn.centre * rng.uniform(-1.0, 1.0, 3)).tolist()
    params.elbow_centre = (params.elbow_centre + drawn.centre * rng.uniform(-1.0, 1.0, 3)).tolist()
    robot = robot.with_home(drawn_posture(robot, np.deg2rad(drawn.posture), rng))
    return three_level_job(robot, params, scenario.own_seed(number))


def build_person(scenario: Any, number: int, options: RunOptions | None = None) -> ThreeLevelCell:
    """Build the diagram of one job."""
    single = deepcopy(scenario)
    single.seed = scenario.own_seed(number)
    truth, meshcat = single.truth(scenario.arm.controller.period), None if options is None else options.meshcat
    return build_three_level(with_faults(draw_person(scenario, number), truth), meshcat, truth)


def run_person(scenario: Any, number: int, options: RunOptions, label: str) -> Trial:
    """Run one job and judge it."""
    cell = build_person(scenario, number, options)
    run = Simulation(cell.diagram, label, options)
    run.to(scenario.duration)
    log = run.log(cell.recorder)
    add_three_level_signals(cell, log)
    values = judged_person(cell, log)
    met = not values["hard_violation"] and not values["command_over_limit"]
    about = (
        f"clearance {1e3 * values['clearance_margin_m']:+.1f} mm of the asked one, "
        f"joint limits {values['limit_margin_rad']:+.4f} rad, command {values['speed_share_max']:.3f} of its limit"
    )
    title = f"Reverse priority, trial {number}"
    shown = Shown(
        log,
        lambda: three_level_figure(cell, log, title),
        lambda path: three_level_replay(cell, log, Path(path), title),
    )
    return Trial(number, values, met, about, shown)


def judged_person(cell: ThreeLevelCell, log: Log) -> dict[str, float]:
    """Return what one job comes to, at every sample of 1 ms."""
    robot, q = cell.job.robot, log["position"]
    clearance = float(log["clearance_min"].min()) - cell.job.params.clearance
    margin = float(min((robot.q_max - q).min(), (q - robot.q_min).min()))
    speed, excess = limit_metrics(robot, log["velocity"], log["torque_excess"])
    return {
        "hard_violation": float(clearance < 0.0 or margin < 0.0),
        "command_over_limit": float(np.sum(log["speed_share"] > 1.0 + 1e-9)),
        "clearance_margin_m": clearance,
        "limit_margin_rad": margin,
        "path_error_median_m": float(np.median(log["path_error"])),
        "speed_share_max": float(log["speed_share"].max()),
        speed.name: speed.value,
        excess.name: excess.value,
    }


def person_metrics(columns: Mapping[str, Array]) -> list[Metric]:
    """Return the metrics of the contract: jobs with a violation, samples with a command beyond the limits."""
    return [
        *share_metrics("meets_all_share", columns["met"]),
        Metric("hard_violations", columns["hard_violation"].sum(), "1", high=0.0),
        Metric("command_over_limit", columns["command_over_limit"].sum(), "1", high=0.0),
        Metric("clearance_margin_min_m", columns["clearance_margin_m"].min(), "m", low=0.0, decides=False),
        Metric("limit_margin_min_rad", columns["limit_margin_rad"].min(), "rad", low=0.0, decides=False),
        Metric("joint_speed_share_max", columns["joint_speed_share_max"].max(), "1", high=1.0, decides=False),
        Metric("torque_excess_max", columns["torque_excess_max"].max(), "Nm", high=0.0, decides=False),
    ]
