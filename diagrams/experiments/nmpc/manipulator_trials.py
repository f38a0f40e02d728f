"""Random jobs of the manipulator: start, goal, and obstacles near the way, with the goal posture clear of them."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.nmpc.build import build_nmpc
from experiments.nmpc.figures import manipulator_figure, nmpc_replay
from experiments.nmpc.jobs import point_positions
from experiments.nmpc.manipulator import last_link, manipulator_job, points_along
from experiments.nmpc.run import NmpcRun, margins, simulate
from experiments.trials import Panel, Shown, Trial, drawn_posture, share_metrics
from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_positive
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.simulation import RunOptions

Array = NDArray[np.float64]
POSITION, TURN = 1e-3, 0.005  # m, rad: a pose that is reached
PANELS = (
    Panel("position_error_m", 1e3, "position error at the end [mm]", POSITION),
    Panel("distance_margin_m", 1e3, "least distance beyond the asked one [mm]", 0.0),
    Panel("joint_speed_share_max", 1e2, "largest joint speed [% of its limit]", 1.0),
)
_DRAWS = 2000


@dataclass
class RandomJobParameters:
    """How random jobs are drawn."""

    # deg; each joint starts up to `posture` from home, and goes up to `turn` from there. Inside the limits by `inside`.
    posture: float = 45.0
    turn: float = 60.0
    inside: float = 8.0
    # Obstacle points; each m, up to `near` from where the arm would go, and `room` farther than asked from its ends.
    obstacles: int = 2
    near: float = 0.25
    room: float = 0.02
    # m; least height of what moves.
    height: float = 0.1

    def __post_init__(self) -> None:
        require_positive(self, "posture", "turn", "near", "room", "height")
        if self.obstacles < 0:
            raise ParameterError("obstacles", f"must not be negative, got {self.obstacles}")


def manipulator_trial(scenario: Any, number: int) -> Any:
    """Return the scenario of one job, of a `ManipulatorScenario`; it is the same on every machine."""
    single = deepcopy(scenario)
    robot = catalog.load(scenario.robot)
    start, goal, obstacles = draw_job(robot, scenario.job, scenario.random, [scenario.seed, number])
    single.job.start_deg, single.job.goal_deg = np.rad2deg(start).tolist(), np.rad2deg(goal).tolist()
    single.job.obstacles = obstacles.tolist()
    single.seed = scenario.own_seed(number)
    return single


def draw_job(robot: RobotModel, job: Any, params: RandomJobParameters, seed: list[int]) -> tuple[Array, Array, Array]:
    """Return start and goal posture (n,), and obstacle points (k, 3) that keep their distance from the arm in both.

    Raises
    ------
    ParameterError
        If none could be drawn.
    """
    rng, inside = np.random.default_rng(seed), np.deg2rad(params.inside)
    points = points_along(robot, job.end_effector or last_link(robot), job.d_min, job.c)
    low, high = robot.q_min + inside, robot.q_max - inside

    def places(q: Array) -> Array:
        return point_positions(robot, points, evaluate_dynamics(robot, q, np.zeros(robot.n)))

    for _ in range(_DRAWS):
        start = np.clip(drawn_posture(robot, np.deg2rad(params.posture), rng), low, high)
        goal = np.clip(start + np.deg2rad(params.turn) * rng.uniform(-1.0, 1.0, robot.n), low, high)
        way = np.array([places(start + share * (goal - start)) for share in np.linspace(0.0, 1.0, 9)])
        if way[:, 2:, 2].min() < params.height:
            continue
        obstacles: list[Array] = []
        for _ in range(_DRAWS if params.obstacles else 0):
            middle = way[rng.integers(2, 7), rng.integers(2, len(points))]
            place = middle + params.near * rng.uniform(-1.0, 1.0, 3)
            ends = np.linalg.norm(np.concatenate([way[0], way[-1]]) - place, axis=1).min()
            if ends > job.d_min + params.room and place[2] > 0.0:
                obstacles.append(place)
            if len(obstacles) == params.obstacles:
                break
        if len(obstacles) == params.obstacles:
            return start, goal, np.reshape(obstacles, (-1, 3))
    raise ParameterError("random", f"no job could be drawn in {_DRAWS} tries")


def run_manipulator_trial(scenario: Any, number: int, options: RunOptions, label: str) -> Trial:
    """Run one job and judge it."""
    single = manipulator_trial(scenario, number)
    cell = build_nmpc(
        manipulator_job(single.known(catalog.load(single.robot)), single.job),
        single.job.cell,
        options.meshcat,
        truth=single.truth(single.job.cell.time_step),
    )
    run = simulate(cell, single.duration, label, options)
    values = judged_job(run, single.job.d_min)
    met = bool(values["reached"]) and values["distance_margin_m"] >= 0.0 and not values["limit_violated"]
    about = (
        f"{1e3 * values['position_error_m']:.1f} mm and {values['orientation_error_rad']:.3f} rad from the pose, "
        f"distance {1e3 * values['distance_margin_m']:+.0f} mm of the asked one"
    )
    view = ((2.0, -1.4, 1.3), (0.1, 0.0, 0.5))
    title = f"Predictive control of a manipulator, trial {number}"
    shown = Shown(
        run.log, lambda: manipulator_figure(run, title), lambda path: nmpc_replay(run, Path(path), title, view)
    )
    return Trial(number, values, met, about, shown)


def judged_job(run: NmpcRun, d_min: float) -> dict[str, float]:
    """Return what one job comes to: the pose of the last half second, the distance of every step of 1 ms."""
    log, found = run.log, {metric.name: metric for metric in margins(run)}
    last = log.time >= log.time[-1] - 0.5
    position, turn = log["position_error"][last, 0].max(), log["orientation_error"][last, 0].max()
    inside = ("limit_margin_rad", "max_speed_share", "joint_speed_share_max")
    return {
        "position_error_m": float(position),
        "orientation_error_rad": float(turn),
        "reached": float(position <= POSITION and turn <= TURN),
        "distance_margin_m": float(log["distance"].min()) - d_min,
        "limit_violated": float(not all(found[name].met for name in inside)),
        **{name: found[name].value for name in (*inside, "torque_excess_max")},
        "step_ms_p99": float(np.percentile(1e3 * run.steps["step_time"][1:, 0], 99)),
    }


def manipulator_trial_metrics(columns: Mapping[str, Array]) -> list[Metric]:
    """Return the metrics of the contract; distance and limits decide."""
    return [
        *share_metrics("reached_share", columns["reached"]),
        *share_metrics("meets_all_share", columns["met"]),
        Metric("min_distance_margin_m", columns["distance_margin_m"].min(), "m", low=0.0),
        Metric("limit_violations", columns["limit_violated"].sum(), "1", high=0.0),
        Metric("joint_speed_share_max", columns["joint_speed_share_max"].max(), "1", high=1.0, decides=False),
        Metric("torque_excess_max", columns["torque_excess_max"].max(), "Nm", high=0.0, decides=False),
        Metric("step_ms_p99", columns["step_ms_p99"].max(), "ms"),
    ]
