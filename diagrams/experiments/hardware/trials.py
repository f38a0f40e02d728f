"""Trials of a real robot's station over the FCI, beyond one run: kills, minutes, and a table of three plants.

``python -m experiments.hardware.trials kills [N] | minute [SECONDS] | table [SEEDS]``, in the folder of the scripts.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from copy import deepcopy
from pathlib import Path

import numpy as np

from experiments.hardware.cell import FR3_HOME, SIM, HardwareScenario
from experiments.hardware.judge import cycle_metrics, measured
from experiments.hardware.run import run_case, run_franka_sim
from experiments.hardware.server import ROOT, FrankaSim
from saphari_drake.robots import catalog
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.runner.results import table

SWING = ROOT / "tests" / "station_swing.py"
STANDS = 0.05  # rad/s


def fr3() -> RobotModel:
    """Return the FR3 in its maker's home posture."""
    return catalog.load(str(catalog.models_dir() / "fr3" / "fr3.urdf"), home=np.deg2rad(FR3_HOME))


def killed(robot: RobotModel, after: float) -> dict[str, float]:
    """Return what became of an arm whose diagram swung it, and was killed some time (s) after its begin."""
    with FrankaSim(robot) as server:
        command = [sys.executable, str(SWING), f"fci://{FrankaSim.HOST}", str(robot.path), "60"]
        environ = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "diagrams")])}
        with subprocess.Popen(command, stdout=subprocess.PIPE, env=environ) as process:
            if process.stdout is not None:
                process.stdout.readline()
            server.begin()
            time.sleep(after)
            process.send_signal(signal.SIGKILL)
        time.sleep(1.0)
        truth, warnings = server.close(), server.warnings()
    q, v, t = truth["q"], np.abs(truth["v"]), truth["time"]
    now = int(np.argmin(np.abs(t - after)))
    moving = np.flatnonzero(v[now:].max(axis=1) > STANDS)
    return {
        "speed_at_kill": float(v[now].max()),
        "stands_after_s": float(moving[-1] + 1) * 1e-3 if moving.size else 0.0,
        "way_rad": float(np.abs(q[now:] - q[now]).max()),
        "speed_share_max": float((v / robot.v_max).max()),
        "inside": float(np.all((q > robot.q_min) & (q < robot.q_max))),
        "speed_at_end": float(v[-1].max()),
        "violations": float(len(warnings)),
    }


def kills(count: int) -> None:
    """Kill the diagram's process at random times of its swing."""
    robot, rng = fr3(), np.random.default_rng(0)
    print("speed at kill [rad/s]  stands after [s]  way [rad]  largest speed/limit  inside  speed at end  violations")
    for _ in range(count):
        row = killed(robot, 1.0 + 2.0 * rng.uniform())
        print("  ".join(f"{value:12.4g}" for value in row.values()), flush=True)


def minute(seconds: float, scenario_for: Callable[[str], HardwareScenario]) -> None:
    """Run an impedance contact for so long under all that the FCI enforces, and print what became of the cycles."""
    scenario = scenario_for("contact_impedance")
    scenario.duration = seconds
    run, warnings = run_franka_sim(scenario)
    print(table(cycle_metrics(run)), *warnings, f"violations: {len(warnings)}", sep="\n")


def compared(case: str, seeds: int, scenario_for: Callable[[str], HardwareScenario]) -> None:
    """Print the figures of a case in Drake, ideal and realistic, and in MuJoCo over the FCI, with their spread."""
    scenario = scenario_for(case)
    rows: dict[str, dict[str, list[float]]] = {}
    for seed in range(seeds):
        for plant in ("ideal", "realistic", "MuJoCo over FCI"):
            here = deepcopy(scenario)
            here.seed, here.address = seed, SIM
            here.rod.aim[2] += float(np.random.default_rng(seed).uniform(-0.01, 0.01)) if seed else 0.0
            if plant != "MuJoCo over FCI":
                here.plant = plant
                found = measured(run_case(here))
            else:
                found = measured(run_franka_sim(here)[0])
            for name, value in found.items():
                rows.setdefault(name, {}).setdefault(plant, []).append(value)
    for name, plants in rows.items():
        told = (f"{plant} {np.mean(x):.4g} ({np.min(x):.4g} … {np.max(x):.4g})" for plant, x in plants.items())
        print(f"{case:18} {name:24}", "   ".join(told), flush=True)


def main(argv: Sequence[str]) -> int:
    """Run the trials that are named."""
    import hardware

    what, number = [*argv, "", ""][:2]
    if what == "kills":
        kills(int(number or 10))
    elif what == "minute":
        minute(float(number or 60.0), hardware.scenario_for)
    elif what == "table":
        for case in hardware.CASES:
            compared(case, int(number or 3), hardware.scenario_for)
    else:
        print(__doc__, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    sys.exit(main(sys.argv[1:]))
