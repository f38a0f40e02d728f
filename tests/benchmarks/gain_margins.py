"""How far the gains of hand guiding and of the ball experiment may be off before a bound is missed: ±50 % is aimed at.

Each gain by itself, and all of a case together, times a factor. Printed are the misses, and the factors farthest from
1 at which all bounds are met.

Run: python tests/benchmarks/gain_margins.py [--script NAME] [--case NAME] [--seeds 0 1]
"""

import argparse
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "diagrams"))

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.runner.experiment import Experiment
from saphari_drake.simulation.runner.results import Metric, bound_text, table
from saphari_drake.simulation.runner.scenario import to_tree, with_assignments
from saphari_drake.simulation.runner.simulation import RunOptions

LOW, HIGH = (0.5, 0.75, 0.9), (1.5, 1.25, 1.1)  # the farthest first
GUIDING = tuple(f"system.pipeline.controller.{name}" for name in ("K_P", "K_D", "force_time"))
RATE, GAMMA = "system.disturbance.rate", "system.controller.gamma"
# The gains that a case depends on, and that were chosen and not given.
GAINS = {
    "skin_hand_guiding": dict.fromkeys(("end_effector_first", "body_first", "recorded"), GUIDING),
    "null_space_ball": {"task_error": (RATE,), "task_error_pd": (RATE, GAMMA)},
}


def value_at(scenario: object, path: str) -> float:
    """Return the parameter at a dotted path."""
    tree = to_tree(scenario)
    for name in path.split("."):
        tree = tree[name]
    return float(tree)


def misses(experiment: Experiment, case: str, paths: Sequence[str], factor: float, seeds: Sequence[int]) -> list[str]:
    """Return what is missed with some gains multiplied by a factor: metrics that decide, or gains that are refused."""
    scenario, found = experiment.scenario_for(case), []
    gains = [f"{path}={factor * value_at(scenario, path)!r}" for path in paths]
    for seed in seeds:
        try:
            outcome = experiment.run(with_assignments(scenario, [*gains, f"seed={seed}"]), RunOptions())
        except ParameterError as error:
            return [f"refused: {error}"]
        found += [
            f"{m.name} {m.value:.3g} ({bound_text(m.low, m.high)}), seed {seed}"
            for m in outcome.metrics
            if m.decides and not m.met
        ]
    return found


def sweep(experiment: Experiment, case: str, paths: tuple[str, ...], seeds: Sequence[int]) -> list[Metric]:
    """Return, of each gain and of all together, the least and the largest factor at which all bounds are met."""
    metrics = []
    nominal = misses(experiment, case, (), 1.0, seeds)
    print(f"as they are: {'; '.join(nominal) or 'all bounds met'}", flush=True)
    for group in [(path,) for path in paths] + ([paths] if len(paths) > 1 else []):
        name = "_and_".join(path.rpartition(".")[2] for path in group)
        for factors, side in ((LOW, "low"), (HIGH, "high")):
            reached = float("nan") if nominal else 1.0
            for factor in factors:
                missed = misses(experiment, case, group, factor, seeds)
                if not missed:
                    reached = factor
                    break
                print(f"{name} × {factor:g}: {'; '.join(missed)}", flush=True)
            bound = {"high": LOW[0]} if side == "low" else {"low": HIGH[0]}
            metrics.append(Metric(f"{name}_factor_{side}", reached, "1", decides=False, **bound))
    return metrics


def main() -> None:
    """Print the misses and a table for each case."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--script", choices=GAINS, action="append")
    parser.add_argument("--case", action="append")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    options = parser.parse_args()
    for name in options.script or GAINS:
        experiment = importlib.import_module(name).EXPERIMENT
        for case, paths in GAINS[name].items():
            if not options.case or case in options.case:
                print(f"\n{name} / {case}", flush=True)
                print(table(sweep(experiment, case, paths, options.seeds)), flush=True)


if __name__ == "__main__":
    main()
