"""Wall time of one control cycle of hand guiding on one pinned thread, and stiffness of hands that gains hold with.

The cycle: all dynamics of the arm, forces, touches, priorities, limits and torque, with nobody, one and two hands.

Run: python tests/benchmarks/benchmark_hand_guiding.py [--json FILE]
"""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np  # noqa: E402
from bench import Timings, benchmark_options  # noqa: E402

from saphari_drake.control.hand_guiding.law import HandGuiding  # noqa: E402
from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters  # noqa: E402
from saphari_drake.control.hand_guiding.stability import GuidingLoop, max_hand_stiffness  # noqa: E402
from saphari_drake.control.hand_guiding.system import sense  # noqa: E402
from saphari_drake.messages import SkinContact, SkinReading  # noqa: E402
from saphari_drake.robots import catalog  # noqa: E402
from saphari_drake.robots.dynamics import evaluate_dynamics  # noqa: E402

STEPS, LIMIT_MS = 1500, 0.3
MASSES, DAMPINGS, ARM_MASSES = (1.0, 2.0, 5.0, 10.0, 15.0), (10.0, 20.0, 30.0, 60.0, 90.0), (1.0, 3.0, 10.0)


def cycle_times(F_e: float, F_b: float, feedback: str) -> np.ndarray:
    """Return the wall time of each cycle (s) with forces of these sizes (N) on an arm that does what it is told."""
    robot = catalog.lwr4()
    robot.home = np.deg2rad([90.0, -35.0, 0.0, 68.0, 0.0, -45.0, 0.0])
    guiding = HandGuiding(robot, HandGuidingParameters(tip_point=[0.0, 0.0, 0.12], feedback=feedback))
    state = guiding.start(evaluate_dynamics(robot, robot.home, np.zeros(robot.n)))
    p, n = np.array([0.0, 0.065, 0.1]), np.array([0.0, 1.0, 0.0])
    seconds = np.empty(STEPS)
    for k in range(STEPS):
        swing = np.sin(2.0 * np.pi * k / 500.0)
        contacts = (SkinContact(2, p, n, np.array([0.5 * swing, -1.0, swing]) * F_b),) if F_b and k > 5 else ()
        reading = SkinReading(contacts)
        wrench = np.array([0.0, 0.0, 0.0, swing, 0.5, 0.0]) * (F_e if k > 5 else 0.0)
        q, v = state.q, state.v
        start = time.perf_counter()
        terms = evaluate_dynamics(robot, q, v)
        state, _ = guiding.step(state, terms, sense(terms, reading, wrench, guiding.tip))
        seconds[k] = time.perf_counter() - start
    return seconds[100:]


def print_table(title: str, loop: GuidingLoop) -> None:
    """Print the stiffest hand (N/m) of each mass and damping, and mark those that hold from 100 to 3000."""
    print(f"\n{title}: stiffest undamped hand that is stable [N/m]; * all from 100 to 3000 N/m")
    print(f"{'M [kg] / D [Ns/m]':>18}" + "".join(f"{damping:>10g}" for damping in DAMPINGS))
    for mass in MASSES:
        row = [min(max_hand_stiffness(replace(loop, mass=mass, damping=damping, arm_mass=arm_mass))
                   for arm_mass in ARM_MASSES) for damping in DAMPINGS]  # fmt: skip
        print(f"{mass:>18g}" + "".join(f"{k:>9.0f}{'*' if k >= 3000.0 else ' '}" for k in row))


def main() -> None:
    """Print the cycle times and the tables."""
    options, timings = benchmark_options(__doc__), Timings()
    print(f"{'one control cycle, 7 joints':44}{'median ms':>10}{'p95 ms':>10}")
    for name, F_e, F_b, feedback in (
        ("nobody touches", 0.0, 0.0, "measured"),
        ("one hand", 5.0, 0.0, "measured"),
        ("two hands", 5.0, 5.0, "measured"),
        ("two hands, commanded motion as feedback", 5.0, 5.0, "commanded"),
    ):
        seconds = cycle_times(F_e, F_b, feedback)
        timings.add(name, seconds, LIMIT_MS)
        seconds *= 1e3
        median = float(np.median(seconds))
        verdict = "pass" if median <= LIMIT_MS else "FAIL"
        print(f"{name:44}{median:10.4f}{np.percentile(seconds, 95):10.4f}  ≤ {LIMIT_MS} ms: {verdict}")
    timings.write(options.json)
    own = HandGuidingParameters()
    print_table("Torque interface", GuidingLoop(own))
    print_table(
        "Torque interface, force filtered with 2 ms and a cycle late", GuidingLoop(own, force_lag=0.002, force_delay=1)
    )
    stiff = HandGuidingParameters(feedback="commanded")
    print_table("Position interface, servo of 200 rad/s", GuidingLoop(stiff, servo=(4e4, 400.0)))


if __name__ == "__main__":
    main()
