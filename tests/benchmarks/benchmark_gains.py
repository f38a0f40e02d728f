"""Which bounds of hand guiding and of the ball experiment hold with gains half as large, and half as large again.

Each gain by itself, and all of a script together. Printed is, of each metric that decides a verdict, the worst value,
and the gains that gave it.

Run: python tests/benchmarks/benchmark_gains.py [--script NAME] [--case NAME] [--seeds 0 1]
"""

import argparse
import importlib
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2] / "diagrams"))

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.runner.experiment import Experiment, Metric, RunOptions
from saphari_drake.simulation.runner.results import bound_text
from saphari_drake.simulation.runner.scenario import to_tree, with_assignments

FACTORS = (0.5, 1.5)
GUIDING = tuple(f"system.controller.{name}" for name in ("K_P", "K_D", "force_time"))
RATE, GAMMA = "system.disturbance.rate", "system.controller.gamma"
# The gains that a case depends on, and that were chosen and not given.
GAINS = {
    "skin_hand_guiding": dict.fromkeys(("end_effector_first", "body_first", "recorded"), GUIDING),
    "null_space_ball": {"task_error": (RATE,), "task_error_pd": (RATE, GAMMA)},
}


class Worst(NamedTuple):
    """The run in which a metric is farthest beyond its bounds, or nearest to them."""

    metric: Metric
    where: str

    @property
    def excess(self) -> float:
        """How far it is beyond its bound, in parts of the bound; negative within."""
        m = self.metric
        if not math.isfinite(m.value):
            return math.inf
        return max((m.value - m.high) / abs(m.high or 1.0), (m.low - m.value) / abs(m.low or 1.0))


def settings(paths: tuple[str, ...]) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield a name and the factor of each gain: as they are, one by one, and together."""
    yield "as they are", {}
    groups = [(path,) for path in paths] + ([paths] if len(paths) > 1 else [])
    for factor in FACTORS:
        for group in groups:
            name = " and ".join(path.rpartition(".")[2] for path in group)
            yield f"{name} × {factor:g}", dict.fromkeys(group, factor)


def value_at(scenario: object, path: str) -> float:
    """Return the parameter at a dotted path."""
    tree = to_tree(scenario)
    for name in path.split("."):
        tree = tree[name]
    return float(tree)


def sweep(experiment: Experiment, case: str, paths: tuple[str, ...], seeds: list[int]) -> tuple[list[Worst], list[str]]:
    """Return the worst of each metric that decides, and the gains that were refused."""
    worst: dict[str, Worst] = {}
    refused = []
    for where, factors in settings(paths):
        for seed in seeds:
            scenario = experiment.scenario_for(case)
            gains = [f"{path}={factor * value_at(scenario, path)!r}" for path, factor in factors.items()]
            scenario = with_assignments(scenario, [*gains, f"seed={seed}"])
            try:
                outcome = experiment.run(scenario, RunOptions())
            except ParameterError as error:
                refused.append(f"{where}: {error}")
                break
            for metric in outcome.metrics:
                now = Worst(metric, f"{where}, seed {seed}")
                bounded = bound_text(metric.low, metric.high) != "–"
                if metric.decides and bounded and (metric.name not in worst or now.excess > worst[metric.name].excess):
                    worst[metric.name] = now
    return list(worst.values()), refused


def main() -> None:
    """Print a table for each case."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--script", choices=GAINS, action="append")
    parser.add_argument("--case", action="append")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    options = parser.parse_args()
    for name in options.script or GAINS:
        experiment = importlib.import_module(name).EXPERIMENT
        for case, paths in GAINS[name].items():
            if options.case and case not in options.case:
                continue
            rows, refused = sweep(experiment, case, paths, options.seeds)
            print(f"\n{name} / {case}, gains at {' and '.join(map(str, FACTORS))} of theirs")
            for metric, where in rows:
                bound = bound_text(metric.low, metric.high)
                print(f"{metric.name:<30}{metric.value:>12.4g} {metric.unit:<3} {bound:<24}"
                      f"{'met' if metric.met else 'MISSED':<8}{where}", flush=True)  # fmt: skip
            for line in refused:
                print(f"refused: {line}")


if __name__ == "__main__":
    main()
