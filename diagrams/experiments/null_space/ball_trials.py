"""Random pushes of the ball: posture, point of the arm, and direction."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.contact.random_touches import surface_point_of, turned
from experiments.null_space.figures import comparison
from experiments.null_space.run import Run, build, limits, replay
from experiments.trials import Panel, Shown, Trial, drawn_posture, share_metrics
from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_positive
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.simulation.world.obstacles import TouchPlace, approach

Array = NDArray[np.float64]
DWELL, REST = 1e-5, 0.02  # m of task error while the ball dwells; share of the speed limits at which an arm rests
_DRAWS = 2000
PANELS = (
    Panel("dwell_error_m", 1e6, "task error while the ball dwells [µm]", DWELL),
    Panel("transient_error_m", 1e3, "largest task error [mm]", np.inf),
    Panel("end_speed_share", 1e2, "joint speed at the end [% of its limit]", REST),
    Panel("joint_speed_share_max", 1e2, "largest joint speed [% of its limit]", 1.0),
)


@dataclass
class RandomBallParameters:
    """How random pushes are drawn."""

    # deg; each joint starts up to `posture` from home, and the ball comes up to `tilt` from the surface's normal.
    posture: float = 25.0
    tilt: float = 40.0
    # Links that are touched; m, least height of the point.
    links: list[str] = field(default_factory=lambda: ["link_3", "link_4"])
    height: float = 0.1

    def __post_init__(self) -> None:
        require_positive(self, "posture", "tilt", "height")
        if not self.links:
            raise ParameterError("links", "needs at least one")


def ball_trial(scenario: Any, number: int) -> Any:
    """Return the scenario of one push, of a `NullSpaceScenario`; it is the same on every machine."""
    single = deepcopy(scenario)
    robot = catalog.load(scenario.robot, home=np.deg2rad(scenario.home))
    radius = scenario.system.cell.ball.radius
    home, single.system.cell.ball.touch = draw_ball(robot, radius, scenario.random, [scenario.seed, number])
    single.home, single.aim_spread, single.direction_spread = np.rad2deg(home).tolist(), 0.0, 0.0
    single.seed = scenario.own_seed(number)
    return single


def draw_ball(
    robot: RobotModel, radius: float, params: RandomBallParameters, seed: list[int]
) -> tuple[Array, TouchPlace]:
    """Return a posture (n,) and where the ball touches the arm then.

    Raises
    ------
    ParameterError
        If none could be drawn.
    """
    rng = np.random.default_rng(seed)
    for _ in range(_DRAWS):
        q = drawn_posture(robot, np.deg2rad(params.posture), rng)
        name = params.links[int(rng.integers(len(params.links)))]
        link, terms = robot.link_index(name), evaluate_dynamics(robot, q, np.zeros(robot.n))
        p_W, n_W = surface_point_of(robot, terms, link, rng)
        direction = turned(-n_W, np.deg2rad(params.tilt) * np.sqrt(rng.random()), rng)
        touch = TouchPlace(name, (terms.R_WL[link].T @ (p_W - terms.p_WL[link])).tolist(), direction.tolist())
        if p_W[2] < params.height + radius:
            continue
        try:
            approach(robot.with_home(q), touch, radius)
        except ParameterError:
            continue
        return q, touch
    raise ParameterError("random", f"no push could be drawn in {_DRAWS} tries")


def run_ball(scenario: Any, number: int, options: RunOptions, label: str) -> Trial:
    """Run one push and judge it."""
    single = ball_trial(scenario, number)
    setup = build(single, options.meshcat)
    run = Simulation(setup.diagram, label, options)
    run.to(single.duration)
    result = Run(setup, run.log(setup.recorder), run.log(setup.fast), run.wall, run.cpu)
    values = judged_push(result)
    met = values["dwell_error_m"] <= DWELL and not values["unstable"] and values["joint_speed_share_max"] <= 1.0
    about = (
        f"{single.system.cell.ball.touch.link}, {values['dwell_force_N']:.0f} N, "
        f"error {1e6 * values['dwell_error_m']:.1f} µm, at the end {values['end_speed_share']:.3f} of the speed limit"
    )
    title = f"Null-space compliance, ball, trial {number}"
    shown = Shown(
        result.log,
        lambda: comparison({single.system.controller.observer: result}, title),
        lambda path: replay(result, Path(path), f"{title} (green: contact force)"),
    )
    return Trial(number, values, met, about, shown)


def judged_push(result: Run) -> dict[str, float]:
    """Return what one push comes to; unstable is an arm that does not rest at the end, or is not finite."""
    log, fast, ball = result.log, result.fast, result.setup.scenario.system.cell.ball
    dwell, error = log.between(ball.departure - 0.5, ball.departure), result.error()
    speed, excess = limits(result)
    last = np.abs(fast["velocity"][fast.time >= fast.time[-1] - 0.2] / result.setup.robot.v_max).max()
    force = np.linalg.norm(log["contact"][:, :3], axis=1)
    return {
        "dwell_error_m": float(error[dwell].mean()),
        "transient_error_m": float(error.max()),
        "end_speed_share": float(last),
        "unstable": float(not last <= REST),
        "dwell_force_N": float(force[dwell].mean()),
        speed.name: speed.value,
        excess.name: excess.value,
    }


def ball_metrics(columns: Mapping[str, Array]) -> list[Metric]:
    """Return the metrics of the contract."""
    return [
        *share_metrics("meets_all_share", columns["met"]),
        Metric("dwell_error_max_m", columns["dwell_error_m"].max(), "m", high=DWELL, decides=False),
        Metric("dwell_error_median_m", np.median(columns["dwell_error_m"]), "m"),
        Metric("transient_error_max_m", columns["transient_error_m"].max(), "m"),
        Metric("unstable", columns["unstable"].sum(), "1", high=0.0),
        Metric("joint_speed_share_max", columns["joint_speed_share_max"].max(), "1", high=1.0, decides=False),
        Metric("torque_excess_max", columns["torque_excess_max"].max(), "Nm", high=0.0, decides=False),
    ]
