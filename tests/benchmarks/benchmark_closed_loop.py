"""How long 0.1 s of the closed loop of `contact_impedance` and `null_space_ball` takes, simulated on one pinned core.

Plant, person, sensors, camera, controllers and records, without building and judging. The notes tell the rate by the
processor's own time, which other programs lengthen less, and the load of the machine.

Run: python tests/benchmarks/benchmark_closed_loop.py [--json FILE]
"""

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
sys.path[:0] = [str(Path(__file__).parents[2] / "diagrams"), str(Path(__file__).parents[1])]

import contact_impedance  # noqa: E402
import null_space_ball  # noqa: E402
import numpy as np  # noqa: E402
from bench import Timings, benchmark_options  # noqa: E402
from experiments.null_space.run import build  # noqa: E402
from pydrake.systems.framework import Diagram  # noqa: E402

from saphari_drake.simulation.runner.simulation import Simulation  # noqa: E402

STRETCH, BEGIN, END = 0.1, 0.5, 4.0  # s; nobody touches before 1.5 s, after that somebody does


def main() -> None:
    """Simulate stretch after stretch, and print and record the wall time of one."""
    options, timings = benchmark_options(__doc__), Timings()
    print(f"{'closed loop':34}{'median ms':>11}{'p95 ms':>9}{'× real time':>13}{'by processor':>17}")
    for name, diagram, aimed in loops():
        wall, cpu = stretches(diagram)
        rates = [STRETCH / float(np.median(seconds)) for seconds in (wall, cpu)]
        load = f"; load of the machine {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
        note = f"{rates[0]:.2f} × real time, by the processor's time {rates[1]:.2f}{load}"
        timings.add(name, wall, None if aimed is None else 1e3 * STRETCH / aimed, note=note)
        median, p95 = (1e3 * float(np.percentile(wall, share)) for share in (50, 95))
        print(f"{name:34}{median:11.1f}{p95:9.1f}{rates[0]:13.2f}{rates[1]:17.2f}")
    timings.write(options.json)


def loops() -> Iterator[tuple[str, Diagram, float | None]]:
    """Yield a name, a diagram, and how many times real time is aimed at."""
    for name, fault, aimed in (("with the camera", "none", 4.0), ("without the camera", "silent", 8.0)):
        scenario = contact_impedance.scenario_for("natural")
        scenario.system.sampler.fault = fault
        yield f"contact_impedance, {name}", contact_impedance.build(scenario).diagram, aimed
    yield "null_space_ball", build(null_space_ball.scenario_for("task_error")).diagram, None


def stretches(diagram: Diagram) -> tuple[np.ndarray, np.ndarray]:
    """Return the wall time and the processor's time of each stretch (s)."""
    run = Simulation(diagram)
    run.to(BEGIN)
    times = []
    for k in range(round((END - BEGIN) / STRETCH)):
        start = time.perf_counter(), time.process_time()
        run.to(BEGIN + (k + 1) * STRETCH)
        times.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    wall, cpu = np.array(times).T
    return wall, cpu


if __name__ == "__main__":
    main()
