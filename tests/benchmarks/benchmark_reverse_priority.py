"""Wall time of one reverse-priority step on one pinned thread: 7 joints, 3 tasks, 5, 20 and 80 unilateral constraints.

Peers on the same job, its upper task and its constraints: Drake's differential IK, and pink with daqp if installed.

Run: python tests/benchmarks/benchmark_reverse_priority.py [--json FILE]
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

import numpy as np  # noqa: E402
from bench import Timings, benchmark_options  # noqa: E402
from experiments.priority.drake_ik import DifferentialIK  # noqa: E402

from saphari_drake.control.reverse_priority import tasks  # noqa: E402
from saphari_drake.control.reverse_priority.stack import PriorityStack  # noqa: E402
from saphari_drake.control.reverse_priority.system import ReversePriorityController, home_references  # noqa: E402
from saphari_drake.robots import catalog  # noqa: E402
from saphari_drake.robots.dynamics import evaluate_dynamics  # noqa: E402
from saphari_drake.robots.model import RobotModel  # noqa: E402

PERIOD, STEPS = 0.005, 1000
LIMIT_MS = 0.1


def levels(robot: RobotModel, constraints: int) -> list[tasks.Level]:
    """Return limits and distances on top, then a position, an elbow coordinate and a joint coordinate."""
    limits = tasks.joint_limits(robot, buffer=0.3)
    bounds = limits[: min(constraints // 2, 7)]
    frames = ["link_4", "link_5", "link_6", "link_7"]
    for k in range(constraints - 2 * len(bounds)):
        component = tasks.target_distance(robot, frames[k % 4], k // 4)
        bounds.append(tasks.Bound(component, lower=0.1, buffer=0.3))
    return [
        bounds,
        tasks.position_task(robot, "link_7"),
        tasks.ScalarTask(tasks.plane_distance(robot, "link_4", [0, 1, 0])),
        tasks.ScalarTask(tasks.joint_coordinate(robot, "joint_7")),
    ]


def states(robot: RobotModel, num_targets: int) -> list[tuple]:
    """Return random postures about home, velocities before, and targets near the arm; the same ones for all."""
    rng = np.random.default_rng(0)
    return [
        (
            robot.home + rng.uniform(-0.4, 0.4, 7),
            rng.uniform(-0.2, 0.2, 7),
            np.hstack([rng.uniform([0.2, -0.4, 0.2], [0.9, 0.4, 0.9], (num_targets, 3)), np.zeros((num_targets, 3))]),
        )
        for _ in range(STEPS)
    ]


def timed(step: Callable, samples: list[tuple]) -> np.ndarray:
    """Return the wall time of each step (s)."""
    for sample in samples[:20]:
        step(*sample)
    seconds = np.empty(len(samples))
    for i, sample in enumerate(samples):
        start = time.perf_counter()
        step(*sample)
        seconds[i] = time.perf_counter() - start
    return seconds


def own(robot: RobotModel, constraints: int) -> tuple[np.ndarray, float]:
    """Return the times of our step, and the mean number of constraints in their buffers."""
    stack = PriorityStack(robot, levels(robot, constraints))
    references = home_references(stack)
    samples = states(robot, stack.num_targets)
    active = np.mean([np.sum(stack.solve(q, v, references, o, PERIOD).activation > 0.0) for q, v, o in samples[:200]])
    return timed(lambda q, v, o: stack.solve(q, 0.95 * v, references, o, PERIOD), samples), float(active)


def as_system(robot: RobotModel) -> np.ndarray:
    """Return the times of the same step in the LeafSystem, with its ports."""
    controller = ReversePriorityController(robot, levels(robot, 20))
    context = controller.CreateDefaultContext()
    port = controller.GetOutputPort("velocity_commanded")

    def step(q: np.ndarray, _: np.ndarray, targets: np.ndarray) -> np.ndarray:
        controller.GetInputPort("position_measured").FixValue(context, q)
        controller.GetInputPort("targets").FixValue(context, targets.ravel())
        return port.Eval(context)

    return timed(step, states(robot, controller.stack.num_targets))


def drake(robot: RobotModel, constraints: int) -> np.ndarray:
    """Return the times of Drake's differential IK: the position task under the same constraints; no lower levels."""
    stack = PriorityStack(robot, levels(robot, constraints))
    distances = np.array([i for i, (b, _) in enumerate(stack.sides) if b.component.unit == "m"])
    ik = DifferentialIK(robot, PERIOD, stack.bounds[distances])
    home = evaluate_dynamics(robot, robot.home, np.zeros(7)).p_WL[6]

    def step(q: np.ndarray, v: np.ndarray, targets: np.ndarray) -> object:
        x, J, own_rate = stack.constraints(q, targets)
        point = evaluate_dynamics(robot, q, v).point(6, np.zeros(3))
        rate = 10.0 * (home - point.p_WC)
        return ik.step(q, v, point.Jv_WC, rate, x[distances] + PERIOD * own_rate[distances], J[distances])

    return timed(step, states(robot, stack.num_targets))


def pink(robot: RobotModel) -> np.ndarray | None:
    """Return the times of pink: three weighted tasks under position and velocity limits, 28 inequalities; no targets.

    Weights stand for the priorities. None without pink.
    """
    try:
        import pink as library
        import pinocchio as pin
        from pink.tasks import FrameTask, PostureTask
    except ImportError:
        return None
    model = pin.buildModelFromUrdf(str(robot.path))
    home = library.Configuration(model, model.createData(), robot.home)
    end, elbow = FrameTask("link_7", 1.0, 0.0), FrameTask("link_4", 0.1, 0.0)
    posture = PostureTask(cost=1e-3)
    for task in (end, elbow, posture):
        task.set_target_from_configuration(home)

    def step(q: np.ndarray, _: np.ndarray, __: np.ndarray) -> np.ndarray:
        configuration = library.Configuration(model, home.data, q)
        return library.solve_ik(configuration, [end, elbow, posture], PERIOD, solver="daqp")

    return timed(step, states(robot, 1))


def row(name: str, seconds: np.ndarray, note: str = "") -> None:
    """Print median and 95th percentile in ms."""
    print(f"{name:44}{1e3 * np.median(seconds):10.4f}{1e3 * np.percentile(seconds, 95):10.4f}  {note}")


def main() -> None:
    """Print the table."""
    options, timings = benchmark_options(__doc__), Timings()
    robot = catalog.lwr4()
    print(f"{'one step, 7 joints, 3 tasks':44}{'median ms':>10}{'p95 ms':>10}")
    for constraints in (5, 20, 80):
        seconds, active = own(robot, constraints)
        verdict = ""
        if constraints == 20:
            verdict = f"; ≤ {LIMIT_MS} ms: {'pass' if 1e3 * np.median(seconds) <= LIMIT_MS else 'FAIL'}"
        limit = LIMIT_MS if constraints == 20 else None
        name = f"reverse priority, {constraints} constraints"
        timings.add(name, seconds, limit, peer=f"Drake differential IK, {constraints} constraints")
        row(name, seconds, f"{active:.1f} active on average{verdict}")
    seconds = as_system(robot)
    timings.add("reverse priority, 20, as a LeafSystem", seconds)
    row("reverse priority, 20, as a LeafSystem", seconds, "with ports")
    for constraints in (5, 20, 80):
        seconds, name = drake(robot, constraints), f"Drake differential IK, {constraints} constraints"
        timings.add(name, seconds, note="1 task, no priorities")
        row(name, seconds, "1 task, no priorities")
    seconds = pink(robot)
    if seconds is None:
        print("pink: not installed (pip install pin-pink)")
    else:
        timings.add("pink, joint position and velocity limits", seconds, note="weights for priorities")
        row("pink, joint position and velocity limits", seconds, "weights for priorities")
    timings.write(options.json)


if __name__ == "__main__":
    main()
