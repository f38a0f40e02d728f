"""Random trials: each drawn from the seed and its own number, run one by one, judged alone and all together."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from saphari_drake.parameters import require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.command_line import say
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.runner.results import Metric, Outcome
from saphari_drake.simulation.view.figures import BOUND, blank

Array = NDArray[np.float64]
Z = 1.959964  # of the normal distribution, 95 % on both sides
OWN_SEED = 1000  # the seed of trial k is that of the scenario plus k times this


@dataclass
class RandomTrials(PlantScenario):
    """A scenario that has a case of random trials."""

    # Number of random trials (≥ 1), and the one to run alone (−1: all); trial k of a seed is the same everywhere.
    trials: int = 4
    trial: int = -1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "trials")

    @property
    def numbers(self) -> list[int]:
        """The trials to run."""
        return [self.trial] if self.trial >= 0 else list(range(self.trials))

    def own_seed(self, number: int) -> int:
        """Return the seed of what is random within a trial: sensors, plant, faults."""
        return self.seed + OWN_SEED * number


class Shown(NamedTuple):
    """What a trial leaves when it runs alone: its signals, its figure, and what writes its replay to a path."""

    log: Log
    figure: Callable[[], Figure]
    replay: Callable[[Path], None]


class Trial(NamedTuple):
    """A finished trial.

    Attributes
    ----------
    number : int
    values : mapping from str to float
        The same names in every trial of a case.
    met : bool
        Whether it meets all that a trial has to meet.
    about : str
        What was drawn, and what it came to, in a few words.
    shown : Shown
    """

    number: int
    values: Mapping[str, float]
    met: bool
    about: str
    shown: Shown


class Panel(NamedTuple):
    """What the figure shows of the trials: a column, what it is multiplied by, its label, and its bound."""

    name: str
    scale: float
    label: str
    bound: float


def run_trials(
    scenario: RandomTrials,
    run_one: Callable[[int, str], Trial],
    metrics: Callable[[Mapping[str, Array]], list[Metric]],
    panels: Sequence[Panel],
    title: str,
) -> Outcome:
    """Run the trials of a scenario; the replay shows the worst: one that misses, the farthest in the first panel.

    A trial that runs alone leaves its own signals and figure, many the values of each and their distributions.

    Parameters
    ----------
    scenario : RandomTrials
    run_one : callable
        Runs a trial by its number; the text is said with its progress.
    metrics : callable
        From the columns of all trials, with `met` (1 or 0), to what they come to.
    panels : sequence of Panel
    title : str
    """
    numbers, rows = scenario.numbers, list[dict[str, float]]()
    lines: list[str] = []

    def runs() -> Iterator[Trial]:
        for k, number in enumerate(numbers, 1):
            trial = run_one(number, f"trial {k} of {len(numbers)}, {k - 1 - len(lines)} met all;")
            rows.append({**trial.values, "met": float(trial.met)})
            if not trial.met:
                lines.append(f"trial {number}: {trial.about} {again(scenario, number)}")
            yield trial

    def worse(one: Trial, other: Trial) -> Trial:
        key = panels[0].name
        return other if (other.met, -other.values[key]) < (one.met, -one.values[key]) else one

    worst = reduce(worse, runs())
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    log = Log(np.array(numbers, dtype=float))
    for name, values in columns.items():
        log.add(name, values, "1")
    if lines:
        say("\n".join(lines))
    everyone = Shown(log, lambda: distributions(columns, panels, title), worst.shown.replay)
    shown = worst.shown if scenario.trial >= 0 else everyone
    return Outcome(
        [*metrics(columns), Metric("trials", len(rows), "1")],
        shown.log,
        shown.figure,
        shown.replay,
        {"failures.txt": "".join(f"{line}\n" for line in lines)},
    )


def again(scenario: Any, number: int) -> str:
    """Return what runs a trial alone."""
    return f"(--case {scenario.case} --seed {scenario.seed} --set trial={number})"


def share_metrics(name: str, met: ArrayLike, low: float = -np.inf, decides: bool = False) -> list[Metric]:
    """Return the share of trials that met something, and the 95 % interval of their rate."""
    values = np.asarray(met, dtype=bool)
    below, above = interval(int(values.sum()), values.size)
    return [
        Metric(name, values.mean(), "1", low=low, decides=decides),
        Metric(f"{name}_from", below, "1"),
        Metric(f"{name}_to", above, "1"),
    ]


def interval(count: int, trials: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate of which `count` of `trials` were seen.

    Wilson's (1927); none or all of the trials bound the rate by 3/n (the rule of three).
    """
    if count in (0, trials):
        far = min(3.0 / trials, 1.0)
        return (0.0, far) if count == 0 else (1.0 - far, 1.0)
    share, spread = count / trials, Z**2 / trials
    centre = (share + 0.5 * spread) / (1.0 + spread)
    half = np.sqrt(spread * (share * (1.0 - share) + 0.25 * spread)) / (1.0 + spread)
    return float(centre - half), float(centre + half)


def drawn_posture(robot: RobotModel, reach: float, rng: np.random.Generator) -> Array:
    """Return home with every joint turned by up to `reach` (rad, or m), within the limits, (n,)."""
    return np.clip(robot.home + reach * rng.uniform(-1.0, 1.0, robot.n), robot.q_min, robot.q_max)


def distributions(columns: Mapping[str, Array], panels: Sequence[Panel], title: str) -> Figure:
    """Return the share of trials up to each value, a panel each."""
    figure, axes = blank(1, len(panels), title, (3.2 * len(panels), 3.4))
    for axis, panel in zip(np.ravel(axes), panels):
        values = np.sort(panel.scale * columns[panel.name])
        axis.step(values, (1.0 + np.arange(values.size)) / values.size, where="post")
        if np.isfinite(panel.bound):
            axis.axvline(panel.scale * panel.bound, color=BOUND, linestyle="--", linewidth=0.9)
        axis.set_xlabel(panel.label)
        axis.set_ylim(0.0, 1.02)
    np.ravel(axes)[0].set_ylabel("share of trials")
    return figure
