"""Random hand guiding: posture, which hand comes first, and how hard and where to both pull."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.guiding import judge
from experiments.guiding.figures import forces_and_velocities, replay
from experiments.guiding.run import GuidingRun, GuidingRuns, GuidingScenario
from experiments.trials import Panel, RandomTrials, Shown, Trial, drawn_posture, share_metrics
from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.parameters import require_positive
from saphari_drake.robots import catalog
from saphari_drake.simulation.people.guiding_hands import Pull
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.simulation import RunOptions

Array = NDArray[np.float64]
DISTURBANCE = 0.02
PANELS = (
    Panel("main_task_disturbance", 1e2, "disturbance of the main task [%]", DISTURBANCE),
    Panel("joint_speed_share_max", 1e2, "largest joint speed [% of its limit]", 1.0),
)


@dataclass
class RandomGuidingParameters:
    """How random guiding is drawn. Ranges are [low, high], uniform."""

    # deg; each joint starts up to so far from the posture of the case that has this order.
    posture: float = 12.0
    # N; size of a pull of the end effector, in any direction; of the body: into the skin, and along it at most.
    pull: list[float] = field(default_factory=lambda: [3.0, 7.0])
    press: list[float] = field(default_factory=lambda: [3.0, 5.0])
    along: float = 2.0

    def __post_init__(self) -> None:
        require_positive(self, "posture", "pull", "press", "along")
        for name in ("pull", "press"):
            value = getattr(self, name)
            if len(value) != 2 or value[0] > value[1]:
                raise ParameterError(name, f"needs [low, high], got {value}")


@dataclass
class RandomGuidingScenario(GuidingScenario, RandomTrials):
    """Guiding, with a case of random trials."""

    random: RandomGuidingParameters = field(default_factory=RandomGuidingParameters)


def draw_guiding(given: RandomGuidingScenario, case: Any, number: int) -> RandomGuidingScenario:
    """Return the scenario of one trial; it is the same on every machine.

    Parameters
    ----------
    given : RandomGuidingScenario
        Of the case random.
    case : callable
        Returns the scenario of a case by its name: here of the case that has the order that is drawn.
    number : int
    """
    rng, params = np.random.default_rng([given.seed, number]), given.random
    order = ("end_effector_first", "body_first")[int(rng.integers(2))]
    template, single = case(order), deepcopy(given)
    single.case, single.home, single.seed = order, template.home, given.own_seed(number)
    robot = catalog.load(given.robot, home=np.deg2rad(template.home))
    single.home = np.rad2deg(drawn_posture(robot, np.deg2rad(params.posture), rng)).tolist()

    def pulled() -> list[float]:
        direction = rng.normal(size=3)
        return (rng.uniform(params.pull[0], params.pull[1]) * direction / np.linalg.norm(direction)).tolist()

    def pressed() -> list[float]:
        return [*(params.along * rng.uniform(-1.0, 1.0, 2)).tolist(), -rng.uniform(params.press[0], params.press[1])]

    single.end_effector.pulls = [_like(pull, pulled()) for pull in template.end_effector.pulls]
    single.body.pulls = [_like(pull, pressed()) for pull in template.body.pulls]
    return single


def _like(pull: Pull, size: list[float]) -> Pull:
    return Pull(pull.start, pull.duration, pull.ramp, size)


def run_guiding(single: RandomGuidingScenario, number: int, synthetic: Path, options: RunOptions) -> Trial:
    """Run one trial, and the same without the second hand, and judge it."""
    runs = GuidingRuns(single, synthetic, options)
    result = runs.get()
    values = judged_guiding(result, runs.get(0.0))
    met = all(values[panel.name] <= panel.bound for panel in PANELS)
    about = (
        f"{single.case}, disturbance {values['main_task_disturbance']:.1%}, speed {values['joint_speed_share_max']:.2f}"
    )
    title = f"Hand guiding, trial {number}"
    shown = Shown(
        result.log,
        lambda: forces_and_velocities(result, runs.get(0.0), f"{title} (dotted: the first hand alone)"),
        lambda path: replay(result, path, f"{title} (orange: end effector, blue: body)"),
    )
    return Trial(number, values, met, about, shown)


def judged_guiding(result: GuidingRun, alone: GuidingRun) -> dict[str, float]:
    """Return what one trial comes to; where the hands never guide together, the disturbance is whole."""
    speed, excess = limit_metrics(result.setup.robot, result.fast["velocity"], result.fast["torque_excess"])
    try:
        disturbance = judge.main_task_disturbance(result, alone)
    except SensorError:
        disturbance = 1.0
    return {
        "main_task_disturbance": disturbance,
        "body_first": float(result.setup.scenario.main),
        speed.name: speed.value,
        excess.name: excess.value,
    }


def guiding_metrics(columns: Mapping[str, Array]) -> list[Metric]:
    """Return the metrics of the contract; none decides."""
    disturbance = columns["main_task_disturbance"]
    return [
        *share_metrics("meets_all_share", columns["met"]),
        Metric("main_task_disturbance_p95", np.percentile(disturbance, 95), "1", high=DISTURBANCE, decides=False),
        Metric("main_task_disturbance_median", np.median(disturbance), "1"),
        Metric("joint_speed_share_max", columns["joint_speed_share_max"].max(), "1", high=1.0, decides=False),
        Metric("torque_excess_max", columns["torque_excess_max"].max(), "Nm", high=0.0, decides=False),
    ]
