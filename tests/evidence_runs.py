"""Made-up runs of experiments, and a folder with a script that ends in milliseconds."""

from experiments.evidence.runs import Job, Run

VERSIONS = {"saphari_drake": "0", "drake": "1", "numpy": "2", "python": "3"}


def document(seed, metrics, verdict="pass"):
    """Return a metrics.json; `metrics` holds (value, low, high, decides) by name."""
    return {
        "metrics": {name: row[0] for name, row in metrics.items()},
        "bounds": {name: [row[1], row[2]] for name, row in metrics.items()},
        "units": dict.fromkeys(metrics, "m"),
        "decides": {name: row[3] for name, row in metrics.items()},
        "reported": {name: f"{name} in the deliverable" for name in metrics},
        "verdict": verdict,
        "scenario": {"seed": seed},
        "versions": VERSIONS,
    }


def made(metrics, seed=0, status=0, given=None):
    """Return a run that ended with `status` and these metrics."""
    return Run(Job("toy", "a", given), status, 1.0, document(seed, metrics, "fail" if status else "pass"))


SCRIPT = '''"""A toy."""
import argparse, json, sys
from pathlib import Path
from types import SimpleNamespace

EXPERIMENT = SimpleNamespace(
    cases={"a": "first", "b": "second"}, scenario_for=lambda case: SimpleNamespace(case=case, seed=4),
    seedless=frozenset(),
)

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--case"), parser.add_argument("--out", type=Path)
    parser.add_argument("--seed", type=int, default=4)
    options = parser.parse_args()
    settings = json.loads((Path(__file__).parent / "settings.json").read_text())
    if options.case == settings.get("broken") and options.seed != settings.get("except"):
        sys.exit("toy: error: no such arm")
    value = settings["error"] + 0.01 * (options.seed % 10)
    folder = options.out / options.case
    folder.mkdir(parents=True)
    metrics = {"error_m": value, "step_ms_median": 1.0 + options.seed}
    met = value <= 0.5
    text = json.dumps({
        "metrics": metrics, "bounds": {"error_m": [None, 0.5], "step_ms_median": [None, None]},
        "units": dict.fromkeys(metrics, "m"), "decides": {"error_m": True, "step_ms_median": False},
        "reported": dict.fromkeys(metrics, ""), "verdict": "pass" if met else "fail",
        "scenario": {"seed": options.seed},
        "versions": {"saphari_drake": "0", "drake": "1", "numpy": "2", "python": "3"},
    })
    (folder / "metrics.json").write_text(text)
    (folder / "threads").write_text(__import__("os").environ["OMP_NUM_THREADS"])
    sys.exit(0 if met else 1)
'''
