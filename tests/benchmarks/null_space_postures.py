"""Null-space compliance on random postures and pushes of two arms: steady task error without and with an observer.

Run: python tests/benchmarks/null_space_postures.py
"""

import argparse
import os
import sys
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from arms import arm_path
from null_space_loop import Loop, bent

from saphari_drake.robots.catalog import lwr4
from saphari_drake.robots.model import RobotModel

POSTURES = ("LWR4", 20), ("xArm7", 5)
DURATION = {"task_error": 2.0, "task_error_pd": 10.0, "momentum": 2.0}  # s; Proposition 2 converges with γ alone


def main() -> None:
    """Print each posture's error without observer, and how much smaller it is with each."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print(f"{'arm':8}{'posture':>8}{'none, µm':>12}" + "".join(f"{name:>16}" for name in DURATION))
    for arm, count in POSTURES:
        robot = lwr4() if arm == "LWR4" else RobotModel(arm_path("xarm7", None))
        ratios = []
        for seed in range(count):
            rest, ratio = 0.0, []
            for observer, duration in DURATION.items():
                none, kept, F, where = Loop.pushed(robot, observer, bent(seed), seed)
                rest = rest or none.run(2.0, F, **where)[-1]
                error = kept.run(duration, F, **where)
                stable = np.all(np.isfinite(error)) and np.abs(kept.v).max() < 0.1
                ratio.append(rest / error[-1] if stable else np.nan)
            ratios.append(ratio)
            print(f"{arm:8}{seed:8}{1e6 * rest:12.1f}" + "".join(f"{value:16.3g}" for value in ratio), flush=True)
        worst = np.min(ratios, axis=0)
        print(f"{arm:8}{'worst':>8}{'':12}" + "".join(f"{value:16.3g}" for value in worst))


if __name__ == "__main__":
    main()
