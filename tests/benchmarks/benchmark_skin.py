"""Time of one skin estimation on one pinned thread: 36 and 1000 modules, up to five touches, a tenth dead.

Time of the thread, which is the wall time on an idle machine, and the wall time.

Run: python tests/benchmarks/benchmark_skin.py [--json FILE]
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
from skin_touches import calibrated  # noqa: E402

from saphari_drake.perception.skin.calibration import SkinCalibration  # noqa: E402
from saphari_drake.perception.skin.estimator import SkinLaw  # noqa: E402
from saphari_drake.perception.skin.layout import SkinLayout, SkinLayoutParameters  # noqa: E402
from saphari_drake.robots import catalog  # noqa: E402
from saphari_drake.simulation.sensors.skin_indenter import IndenterParameters  # noqa: E402
from saphari_drake.simulation.sensors.skin_modules import SkinLoad, SkinModules  # noqa: E402

STEPS = 300
NOISE = 0.001  # V
CASES = [("36 modules", 6, 6, 1.0), ("1000 modules", 25, 40, 5.0)]


def timed(
    layout: SkinLayout, modules: SkinModules, calibration: SkinCalibration, touches: int, dead: int
) -> np.ndarray:
    """Return thread and wall time of each estimation (s), (k, 2), over random touches."""
    rng = np.random.default_rng(0)
    law = SkinLaw(layout, calibration)
    start = replace(law.start(), tare_left=0)
    seconds = np.empty((STEPS, 2))
    for k in range(STEPS):
        uv = rng.uniform(-0.75, 0.75, (touches, 2)) * layout.extent
        p_L, R_L = layout.surface(uv)
        pressed = [SkinLoad(p, -rng.uniform(3.0, 15.0) * R[:, 2], 0.007) for p, R in zip(p_L, R_L)]
        extra = NOISE * rng.standard_normal((layout.count, 4))
        voltages = modules.voltages(*modules.forces(pressed), extra)
        voltages[rng.choice(layout.count, dead, replace=False)] = 0.0
        begin = np.array([time.thread_time(), time.perf_counter()])
        law.sample(start, voltages, 0.0)
        seconds[k] = np.array([time.thread_time(), time.perf_counter()]) - begin
    return seconds[20:]


def main() -> None:
    """Print the table."""
    options, timings = benchmark_options(__doc__), Timings()
    robot = catalog.lwr4()
    print(f"{'one estimation':44}{'median ms':>10}{'p95 ms':>10}{'wall':>10}{'p95':>10}")
    for name, rows, columns, limit in CASES:
        layout = SkinLayout(robot, SkinLayoutParameters(rows=rows, columns=columns))
        modules = SkinModules(layout)
        calibration = calibrated(modules, IndenterParameters(presses=40))
        for touches in (0, 1, 2, 5):
            for dead in (0, layout.count // 10):
                seconds = timed(layout, modules, calibration, touches, dead)
                ms = 1e3 * seconds
                (own, wall), (own_95, wall_95) = np.median(ms, axis=0), np.percentile(ms, 95, axis=0)
                verdict = f"≤ {limit} ms: {'pass' if own <= limit else 'FAIL'}"
                what = f"{name}, {touches} touches, {dead} dead"
                timings.add(what, seconds[:, 1], limit)
                print(f"{what:44}{own:10.3f}{own_95:10.3f}{wall:10.3f}{wall_95:10.3f}  {verdict}")
    timings.write(options.json)


if __name__ == "__main__":
    main()
