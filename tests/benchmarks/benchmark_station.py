"""Jitter of the loop that talks to a robot at 1 kHz, in Python on this machine, against a robot that is a clock.

Guard, shared memory and bookkeeping are those of a real robot; what its interface takes for itself is not in it. A
cycle misses its deadline if its command is given later than a period after it was due. With --busy another process
computes on every core. Whether a real-time priority was granted is printed; without one a busy machine makes a loop
late by whole time slices.

Run: python tests/benchmarks/benchmark_station.py [--seconds S] [--priority N] [--busy] [--json FILE]
"""

import argparse
import multiprocessing
import os
import sys
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np  # noqa: E402
from bench import Timings  # noqa: E402

from saphari_drake.robots import catalog  # noqa: E402
from saphari_drake.stations.arm import ArmReading  # noqa: E402
from saphari_drake.stations.guard import Guard  # noqa: E402
from saphari_drake.stations.loop import serve  # noqa: E402
from saphari_drake.stations.parameters import StationParameters  # noqa: E402
from saphari_drake.stations.priority import undisturbed  # noqa: E402
from saphari_drake.stations.shared import open_link  # noqa: E402

T = 0.001


class Clock:
    """A robot that stands, whose cycles are those of the clock: none waits for a loop that is late."""

    def __init__(self, q, count, link):
        self.q, self.count, self.link, self.k = q, count, link, 0
        self.woken, self.done = np.full(count, np.nan), np.full(count, np.nan)
        self.start = time.perf_counter()

    def read(self):
        now = time.perf_counter() - self.start
        self.k = max(self.k + 1, int(now / T))
        time.sleep(max(self.start + self.k * T - time.perf_counter(), 0.0))
        if self.k + 1 >= self.count:
            self.link.command.write(close=1.0)
        self.due = self.start + self.k * T
        self.note(self.woken)
        return ArmReading(self.q, np.zeros(len(self.q)), np.zeros(len(self.q)), self.k * T)

    def write(self, torque, gravity):
        self.note(self.done)

    def note(self, where):
        if self.k < self.count:
            where[self.k] = time.perf_counter() - self.due


def compute():
    """Keep a core busy, arithmetic and memory."""
    x = np.random.default_rng(0).standard_normal((300, 300))
    while True:
        x = x @ x / np.linalg.norm(x)


def main():
    """Print and note how late cycles wake and how late their commands are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--priority", type=int, default=StationParameters().priority, help="0: none")
    parser.add_argument("--busy", action="store_true", help="other processes compute on every core")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to FILE")
    options, timings = parser.parse_args(), Timings()
    others = [multiprocessing.Process(target=compute, daemon=True) for _ in range(os.cpu_count() * options.busy)]
    for other in others:
        other.start()
    robot, params = catalog.lwr4(), StationParameters(priority=options.priority, end_time=0.0)
    link, guard = open_link(robot.n), Guard(robot, params)
    link.path.unlink()
    with undisturbed(params.priority) as granted:
        clock = Clock(robot.home, round(options.seconds / T), link)
        serve(clock, guard, link, params, os.getppid())
    for other in others:
        other.kill()
    served = np.isfinite(clock.done)
    missed = 1.0 - np.mean(served[1:]) + np.mean(clock.done[served] > T) * np.mean(served[1:])
    print(
        f"{options.seconds:g} s, real-time priority {'granted' if granted else 'not granted'}, load {os.getloadavg()}"
    )
    for name, late in (("station loop, wakes late", clock.woken), ("station loop, command after due", clock.done)):
        known = late[np.isfinite(late)]
        timings.add(name, known)
        quantiles = "".join(f"  p{q:g} {1e3 * np.percentile(known, q):.3f}" for q in (50, 99, 99.9, 100))
        print(f"{name:34}{quantiles}  ms")
    runs = np.diff(np.flatnonzero(served & (clock.done <= T)))
    print(f"deadlines missed: {missed:.3e} of all; most in a row: {max(int(runs.max()) - 1, 0)} (the FCI stops at 20)")
    timings.write(options.json)


if __name__ == "__main__":
    main()
