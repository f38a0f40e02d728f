"""Wall time of one estimation and control cycle (5 ms), rendering apart, on one pinned thread; each stage's share.

Run: python tests/benchmarks/benchmark_contact_cycle.py [--json FILE]
"""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.path[:0] = [str(Path(__file__).parents[2] / "diagrams"), str(Path(__file__).parents[1])]

import contact_impedance as script  # noqa: E402
import numpy as np  # noqa: E402
from bench import Timings, benchmark_options  # noqa: E402
from experiments.contact.cell import learn_background  # noqa: E402
from experiments.contact.cycle_time import time_cycles  # noqa: E402
from experiments.contact.run import ContactSetup  # noqa: E402
from pydrake.systems.analysis import Simulator  # noqa: E402

from saphari_drake.control.contact.law import contact_impedance_torque  # noqa: E402
from saphari_drake.estimation.contact_force import estimate_contact_force  # noqa: E402
from saphari_drake.estimation.momentum_observer import residual  # noqa: E402
from saphari_drake.perception.contact.places import PlaceFinder  # noqa: E402
from saphari_drake.perception.segmentation.robot_filter import RobotFilter  # noqa: E402
from saphari_drake.robots.dynamics import evaluate_dynamics  # noqa: E402

SECONDS = 3.0  # simulated before the measurement; the hand pushes by then
STEPS = 600


def main() -> None:
    """Simulate up to a push, then time whole cycles and single stages on that state and image."""
    options, timings = benchmark_options(__doc__), Timings()
    scenario = script.scenario_for("modified")
    setup = script.build(scenario)
    simulator = Simulator(setup.diagram)
    simulator.Initialize()
    start = time.perf_counter()
    simulator.AdvanceTo(SECONDS)
    with_camera = SECONDS / (time.perf_counter() - start)
    context, parts, robot = simulator.get_context(), setup.parts, setup.robot
    sampler = parts.sampler
    depth = sampler.GetOutputPort("depth_image").Eval(sampler.GetMyContextFromRoot(context)).data[..., 0].copy()
    log = setup.recorder.log(setup.diagram, context)
    states = np.hstack([log["position"], log["velocity"]])[-200:]
    states = np.tile(states, (STEPS // len(states) + 1, 1))[:STEPS]
    system = scenario.system
    background = learn_background(robot, system, 3)
    seconds, with_frame = time_cycles(robot, system.camera, system.pipeline, states, depth, background)

    print(f"{'whole cycle':34}{'median ms':>11}{'p95 ms':>9}")
    timings.add("all cycles (frames at 30 Hz)", seconds, 2.0, 3.0)
    timings.add("cycles without a new frame", seconds[~with_frame])
    timings.add("cycles with a new frame", seconds[with_frame])
    row("all cycles (frames at 30 Hz)", seconds)
    row("cycles without a new frame", seconds[~with_frame])
    row("cycles with a new frame", seconds[with_frame])
    print(f"\n{'stage':34}{'median ms':>11}{'p95 ms':>9}{'share':>8}")
    total = float(np.median(seconds[with_frame]))
    for name, call in stages(setup, states[-1], depth, background).items():
        times = repeated(call)
        timings.add(name, times)
        row(name, times, total)
    print(f"\nsimulation, times real time: {with_camera:.2f} with the camera, {without_camera():.2f} without")
    timings.write(options.json)


def stages(setup: ContactSetup, state: np.ndarray, depth: np.ndarray, background: np.ndarray) -> dict[str, Callable]:
    """Return each stage as a call without arguments."""
    robot, system, n = setup.robot, setup.scenario.system, setup.robot.n
    q, v = state[:n], state[n:]
    terms = evaluate_dynamics(robot, q, v)
    point = terms.point(5, np.array([0.0, 0.0, 0.072]))
    localizer = system.pipeline.localizer
    finder = PlaceFinder(RobotFilter(robot.shapes, system.camera, localizer, background), localizer)
    r = point.Jv_WC.T @ np.array([30.0, 0.0, 0.0])
    force = estimate_contact_force(point.Jv_WC, r, 0.02)
    gains = setup.parts.pipeline.controller.gains
    return {
        "localization of a frame": lambda: finder.look(depth, terms.R_WL, terms.p_WL),
        "dynamics": lambda: evaluate_dynamics(robot, q, v),
        "residual": lambda: residual(terms.p, terms.p, np.full(n, 50.0)),
        "contact Jacobian": lambda: terms.point(5, point.p_WC),
        "contact force": lambda: estimate_contact_force(point.Jv_WC, r, 0.02),
        "torque law": lambda: contact_impedance_torque(terms, point, point.p_WC, force.F_W, force.misfit, gains),
    }


def without_camera() -> float:
    """Simulated over wall time of the same case with a camera that renders nothing."""
    scenario = script.scenario_for("modified")
    scenario.system.sampler.fault = "silent"
    simulator = Simulator(script.build(scenario).diagram)
    simulator.Initialize()
    start = time.perf_counter()
    simulator.AdvanceTo(SECONDS)
    return SECONDS / (time.perf_counter() - start)


def repeated(call: Callable, count: int = 500) -> np.ndarray:
    """Return the wall time of each of `count` calls (s)."""
    call()
    seconds = np.empty(count)
    for i in range(count):
        start = time.perf_counter()
        call()
        seconds[i] = time.perf_counter() - start
    return seconds


def row(name: str, seconds: np.ndarray, total: float | None = None) -> None:
    """Print median and 95th percentile in ms, and the share of a cycle with a frame."""
    middle = float(np.median(seconds))
    share = "" if total is None else f"{middle / total:8.0%}"
    print(f"{name:34}{1e3 * middle:11.3f}{1e3 * float(np.percentile(seconds, 95)):9.3f}{share}")


if __name__ == "__main__":
    main()
